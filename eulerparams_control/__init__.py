"""Cartesian control of robot arms with Euler parameters and other representations.

The laws are those of Caccavale, Siciliano and Villani, "The Role of Euler
Parameters in Robot Control" (1999); equation numbers in this package refer to it.
NOTATION.md maps its symbols to the names used here.
"""
