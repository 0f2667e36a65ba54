"""What must hold of a sequence, whatever goes wrong in it; each oracle for itself.

An oracle sees what was on the wire and where the arm was, never what the controller thought.
One is added as a class in a file that is imported here.
"""

from eulerparams_control.lab.campaign.oracles import commands, gaps, smoothness, standstill
from eulerparams_control.lab.campaign.oracles.base import Oracle, Violation, judge

__all__ = [
    "Oracle",
    "Violation",
    "commands",
    "gaps",
    "judge",
    "smoothness",
    "standstill",
]
