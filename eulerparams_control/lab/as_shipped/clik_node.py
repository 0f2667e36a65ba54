"""The node ``clik`` with the laws as shipped, those of the pose among them: no executable."""

import sys

from eulerparams_control.lab.as_shipped.node import prepare


def run() -> int:
    """Run the node; return its exit code."""
    prepare()
    from eulerparams_control.lab.as_shipped.pose import PoseClik
    from eulerparams_control.robot.robot import Robot
    from eulerparams_control.ros import runtime
    from eulerparams_control.ros.clik_node import ClikNode

    class PoseClikNode(ClikNode):
        def make_scheme(self, robot: Robot) -> PoseClik:
            return PoseClik(robot, self._params)

    return runtime.run(PoseClikNode, None)


if __name__ == "__main__":
    sys.exit(run())
