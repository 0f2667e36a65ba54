"""Random faults, by the hundred: does what is commanded stay safe, and does it recover?

``plan``      what happens in a sequence, made of its seed alone
``record``    what was seen on the wire
``oracles``   what must hold of that, each for itself
``arm``       the robot of a sequence in lock-step
``schedule``  sequences side by side, each worker a process

What needs ROS is in ``eulerparams_control.lab.campaign.ros``.
"""
