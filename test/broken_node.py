"""A controller with a defect where no message can cause one: python -m broken_node NODE."""

import sys
from typing import Any

from eulerparams_control.laws.clik import Clik
from eulerparams_control.laws.dynamic_control import DynamicControl
from eulerparams_control.ros import clik_node, dynamic_control_node, managed_node, runtime

NODES = {
    "clik": (clik_node.ClikNode, clik_node.main, Clik),
    "dynamic_control": (
        dynamic_control_node.DynamicControlNode,
        dynamic_control_node.main,
        DynamicControl,
    ),
}

# When the desired frame is faster than this [m/s] the defect shows.
MOVES = 0.02

# Time [s] that the arm is given to come to rest: the machine may be busy.
PATIENCE = 60.0


def main() -> int:
    """Run the node named by the first argument with a defect in a timer."""
    managed_node.LONGEST = runtime._STOP_SECONDS = PATIENCE
    node, run, scheme = NODES[sys.argv[1]]
    tick = scheme.tick
    moved = []

    def noticing_tick(self: Any, dt: float, q: Any, dq: Any, desired: Any) -> Any:
        moved.extend([True] * bool(desired.dp_d @ desired.dp_d > MOVES**2))
        return tick(self, dt, q, dq, desired)

    def values_now(_self: Any) -> dict[str, Any]:
        if moved:
            raise ZeroDivisionError("planted in a timer")
        return {}

    scheme.tick = noticing_tick  # type: ignore[method-assign]
    node.values_now = values_now  # type: ignore[method-assign]
    return run(sys.argv[2:])


if __name__ == "__main__":
    sys.exit(main())
