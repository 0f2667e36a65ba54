"""What must hold of a sequence, whatever goes wrong in it; each oracle for itself.

An oracle sees what was on the wire and where the arm was, never what the controller thought.
One is added in one file of this folder, with one line of import here.
"""

from eulerparams_control.lab.campaign.oracles import commands, gaps, jumps, recovery, standstill
from eulerparams_control.lab.campaign.oracles.base import Oracle, Violation, judge

__all__ = [
    "Oracle",
    "Violation",
    "commands",
    "gaps",
    "judge",
    "jumps",
    "recovery",
    "standstill",
]
