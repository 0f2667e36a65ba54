"""What watches over a controller, whatever its scheme is; knows no ROS.

``clock``   the steady clock by which messages age
``states``  which states are believed
``latency`` which states come too late to control by
``runaway`` arms that run away under efforts
``guard``   the last look at a command before it leaves
``pace``    the slow-down towards kinematic singularities and joint limits
"""
