"""Bags: written as ROS 2 Jazzy's own recorder writes them, and read without ROS."""

from eulerparams_control.bags.reader import Bag
from eulerparams_control.bags.recovery import Recovery, recover
from eulerparams_control.bags.writer import BagWriter

__all__ = ["Bag", "BagWriter", "Recovery", "recover"]
