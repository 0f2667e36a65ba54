"""The machine around a law: time, modes, references, and what watches over its commands.

``clock``           the steady clock by which messages age
``admission``       which states are believed, and ``latency`` which come too late to control by
``controller``      from measured state to command
``runaway``         arms that run away under efforts
``command_limiter`` the last look at a command before it leaves
``speed_scaling``   the slow-down towards kinematic singularities and joint limits
"""
