"""The surroundings of the robot; importing this registers the kinds of things.

A kind is one file, or a class in one, and a name below.
"""

from sim_bridge.environment import push, solids, springs
from sim_bridge.environment.base import Environment, Thing, nest, read_environment
from sim_bridge.environment.forces import Force, SensorMotion, total_wrench
from sim_bridge.environment.solids import Solid

__all__ = [
    "Environment",
    "Force",
    "SensorMotion",
    "Solid",
    "Thing",
    "nest",
    "push",
    "read_environment",
    "solids",
    "springs",
    "total_wrench",
]
