"""Random faults, by the hundred: does what is commanded stay safe, and does it recover?

``plan``      what happens in a sequence, made of its seed alone
``user``      who leads the arm
``record``    what was seen on the wire
``oracles``   what must hold of that, each for itself
``schedule``  sequences side by side, each worker a process
``report``    outcomes, page and summary

What needs ROS is in ``eulerparams_control.lab.campaign.ros``.
"""
