"""The simulated robot and its ROS bridge."""
