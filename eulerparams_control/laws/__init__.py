"""The laws of the paper and their mathematics; free of ROS."""
