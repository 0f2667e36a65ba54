"""A controller whose law raves when it moves: python -m raving_node NODE HOW."""

import math
import sys
from typing import Any

import numpy as np

from eulerparams_control.laws.clik import Clik
from eulerparams_control.laws.dynamic_control import DynamicControl
from eulerparams_control.laws.scheme import JointCommand, Tick
from eulerparams_control.ros import clik_node, dynamic_control_node

NODES = {
    "clik": (clik_node.main, Clik),
    "dynamic_control": (dynamic_control_node.main, DynamicControl),
}

# How it raves: what it commands of each quantity [rad, rad/s, Nm].
HOW = {"nan": math.nan, "huge": 1e6}

# When the desired frame is faster than this [m/s] it begins.
MOVES = 0.02


def main() -> int:
    """Run the node named by the first argument, which raves as the second says."""
    run, scheme = NODES[sys.argv[1]]
    value, tick = HOW[sys.argv[2]], scheme.tick

    def raving_tick(self: Any, dt: float, q: Any, dq: Any, desired: Any) -> Tick:
        answer = tick(self, dt, q, dq, desired)
        if desired.dp_d @ desired.dp_d < MOVES**2:
            return answer
        command = answer.command
        raves = np.full(len(q), value)
        return answer._replace(
            command=JointCommand(
                q=None if command.q is None else raves,
                dq=None if command.dq is None else raves,
                effort=None if command.effort is None else raves,
            )
        )

    scheme.tick = raving_tick  # type: ignore[method-assign]
    return run(sys.argv[3:])


if __name__ == "__main__":
    sys.exit(main())
