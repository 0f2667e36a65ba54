"""Hundreds of random fault sequences: do the commands stay safe, and does the arm recover?

``plan``      what happens in a sequence, made of its seed alone
``user``      who leads the arm
``record``    what was seen on the wire
``oracles``   what must hold of that, each for itself
``schedule``  sequences side by side, each worker a process
``report``    outcomes, page and summary

What needs ROS is in ``eulerparams_control.lab.campaign.ros``.
"""
