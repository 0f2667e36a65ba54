"""Guards of a control node against its parameters, and against wrong transitions."""

from collections.abc import Callable
from functools import wraps
from typing import Any

from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import SetParametersResult
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode
from rclpy.node import Node

from eulerparams_control.errors import ConfigurationError
from eulerparams_control.parameters.common import SIMULATED_ONLY, ControlParameters
from eulerparams_control.ros.diagnostics import Health

RCLError = rclpy_implementation.RCLError


def refuse_unless_simulated(node: Node, parameters: ControlParameters) -> None:
    """Raise ConfigurationError for what is dangerous outside a simulation."""
    unsafe = parameters.for_simulation
    if unsafe and not node.get_parameter("use_sim_time").value:
        raise ConfigurationError(
            f"{unsafe} is accepted only with use_sim_time: true, in simulation"
        )


def keep_sim_time(node: Node, parameters: Callable[[], ControlParameters]) -> None:
    """Let a node refuse to leave simulated time while something unsafe is set, or set with it."""

    def refuse(changes: list[Any]) -> SetParametersResult:
        new = {change.name: change.value for change in changes}
        if new.get("use_sim_time", True):
            return SetParametersResult(successful=True)
        together = ", ".join(new.keys() & SIMULATED_ONLY)
        unsafe = together or parameters().for_simulation
        reason = f"use_sim_time stays true with {unsafe}" if unsafe else ""
        return SetParametersResult(successful=not unsafe, reason=reason)

    node.add_on_set_parameters_callback(refuse)


def surviving(
    callback: Callable[..., None], on_defect: Callable[[Exception], None]
) -> Callable[..., None]:
    """Return a callback after whose defects ``on_defect`` is called, and the node goes on."""

    @wraps(callback)
    def survive(*message: Any) -> None:
        try:
            callback(*message)
        except Exception as error:
            on_defect(error)

    return survive


def survive_wrong_transitions(node: LifecycleNode, health: Health) -> None:
    """Let a node answer a transition that its state does not have; rclpy would end the process."""
    service = node._service_change_state
    change_state = service.callback

    def guarded(request: ChangeState.Request, response: ChangeState.Response) -> Any:
        try:
            return change_state(request, response)
        except RCLError as error:
            health.complain(f"transition refused: {error}")
            response.success = False
            return response

    service.callback = guarded
