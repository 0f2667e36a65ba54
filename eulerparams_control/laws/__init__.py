"""The laws of the paper, and the mathematics that they stand on; free of ROS."""
