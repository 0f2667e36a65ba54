"""The machine around a law: time, modes, references, and what watches over its commands.

``controller``  from a measured state to its command, and what is asked of the arm
``supervisor``  its mode, and what states and orders make of it; ``mode`` the table
``admission``   which states are believed; ``clock`` time, and how states age
``guidance``    the law on its motion; ``references`` which motions are refused
``pace``        the slow-down towards kinematic singularities and joint limits
``limiter``     the last look at a command before it leaves
"""
