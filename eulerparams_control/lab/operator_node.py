"""The operator of an experiment: calls a service at a time of the simulation; no executable."""

import sys
from dataclasses import dataclass

from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from eulerparams_control.messages.from_ros import ns_from_ros
from eulerparams_control.parameters.fields import parameter
from eulerparams_control.ros.parameters import declare
from eulerparams_control.ros.qos import QOS
from eulerparams_control.ros.runtime import run


@dataclass(frozen=True)
class OperatorParameters:
    """Parameters of the operator."""

    service: str = parameter("", "name of a service that takes no arguments")
    at: float = parameter(0.0, "stamp of joint_states from which on it is called", unit="s")


class OperatorNode(Node):
    """Calls a service once."""

    parameters_type = OperatorParameters

    def __init__(self) -> None:
        super().__init__("operator")
        self.done = False
        self._is_called = False
        self._at = round(1e9 * (p := declare(self, self.parameters_type)).at)
        self._client = self.create_client(Trigger, p.service)
        self.create_subscription(JointState, "joint_states", self._on_joint_states, QOS)

    def _on_joint_states(self, msg: JointState) -> None:
        is_due = not self._is_called and ns_from_ros(msg.header.stamp) >= self._at
        if is_due and self._client.service_is_ready():
            self._is_called = True
            self._client.call_async(Trigger.Request())


if __name__ == "__main__":
    sys.exit(run(OperatorNode, None))
