"""The node ``clik`` with the laws as shipped, those of the pose among them: no executable."""

import sys

from eulerparams_control.lab.as_shipped.node import prepare


def run() -> int:
    """Run the node; return its exit code."""
    prepare()
    from eulerparams_control.lab.as_shipped.pose import PoseClik
    from eulerparams_control.laws.limits import JointLimits
    from eulerparams_control.robot.robot import Robot
    from eulerparams_control.ros import runtime
    from eulerparams_control.ros.clik_node import ClikNode

    class PoseClikNode(ClikNode):
        def make_scheme(self, robot: Robot, limits: JointLimits | None) -> PoseClik:
            p = self._params
            deviation, error, motion = p.max_deviation, p.max_error(), p.motion_limits()
            return PoseClik(robot, p.law(), p.feedback, limits, 0.1, deviation, error, motion)

    return runtime.run(PoseClikNode, None)


if __name__ == "__main__":
    sys.exit(run())
