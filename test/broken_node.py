"""A controller with a defect where no message can cause one: python -m broken_node NODE."""

import sys
from importlib import import_module
from typing import Any

import numpy as np

from eulerparams_control.command_line import executables
from eulerparams_control.control.controller import Controller
from eulerparams_control.ros import control_node, managed_node, runtime

# When a joint is faster than this [rad/s] the defect shows.
MOVES = 0.02
# Time [s] that the arm is given to come to rest: the machine may be busy.
PATIENCE = 60.0


def main() -> int:
    """Run the node named by the first argument with a defect in a timer."""
    managed_node.LONGEST = runtime._STOP_SECONDS = PATIENCE
    step, moved = Controller.step, []

    def noticing_step(self: Any, stamp: Any, q: Any, dq: Any, *more: Any, **given: Any) -> Any:
        moved.extend([True] * bool(np.abs(dq).max() > MOVES))
        return step(self, stamp, q, dq, *more, **given)

    def values_now(_self: Any) -> dict[str, Any]:
        if moved:
            raise ZeroDivisionError("planted in a timer")
        return {}

    Controller.step = noticing_step  # type: ignore[method-assign]
    control_node.ControlNode.values_now = values_now  # type: ignore[method-assign]
    return int(import_module(executables()[sys.argv[1]]).main(sys.argv[2:]))


if __name__ == "__main__":
    sys.exit(main())
