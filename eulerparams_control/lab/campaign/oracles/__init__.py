"""Oracles: each is a property that must hold in a sequence, whatever goes wrong in it.

An oracle sees what was on the wire and where the arm was, never what the controller thought.
One is added as a function in a file of this folder, which is found by being there.
"""

import importlib
import pkgutil

from eulerparams_control.lab.campaign.oracles.base import Oracle, Violation, judge

__all__ = ["Oracle", "Violation", "judge"]

for _module in pkgutil.iter_modules(__path__, f"{__name__}."):
    importlib.import_module(_module.name)
