"""The machine around a law: time, modes, references, and what watches over its commands.

``controller``  from a measured state to its command, and the limits on that
``supervisor``  what changes the mode: states, orders, references; ``mode`` the table, the causes
``admission``   which states are believed; ``clock`` time, how states age, how often they come
``guidance``    which references are refused, and the desired frame of each state; ``pace`` its
                slow-down towards kinematic singularities and joint limits
``limiter``     the last look at a command before it leaves
"""
