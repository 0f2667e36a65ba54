"""To and from ROS messages; the only room but the nodes that knows them."""
