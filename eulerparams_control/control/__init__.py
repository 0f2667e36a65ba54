"""The machine around a law: time, modes, references, and what watches over its commands.

``clock``           the steady clock by which messages age
``admission``       which states are believed, and which arms run away under efforts
``controller``      from measured state to command
``orders``          what is asked of the arm, and ``references`` which motions are refused
``supervisor``      the mode
``limiter``         the last look at a command before it leaves; ``acting`` the one that acts
``pace``            the slow-down towards kinematic singularities and joint limits
"""
