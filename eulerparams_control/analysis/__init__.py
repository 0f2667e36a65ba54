"""Recorded runs as numbers, tables and a page; needs no ROS."""
