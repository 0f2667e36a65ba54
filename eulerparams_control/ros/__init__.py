"""The ROS layer: everything that imports rclpy or messages, besides the bag recorder."""
