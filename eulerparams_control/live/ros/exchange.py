"""Services of the nodes that the page commands: their parameters, halt, resume, unlock."""

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from std_srvs.srv import Trigger

from eulerparams_control.control.clock import steady

CONFIRMS = 0.5
"""Time [s] in which a service answers."""

_ASK_EVERY = 0.5  # [s] for the parameters

Tell = Callable[[str, str], None]


class _Call(NamedTuple):
    """A call of a service: until when [s] it is to be answered; None is what comes of no answer."""

    client: Any
    future: Any
    until: float
    then: Callable[[Any], None]


class Exchange:
    """What is asked of the nodes, and what they answer.

    Args:
        node: that asks.
        controller: its name.
        names: of its parameters.
        services: of type Trigger: the node of each.
        notify, alarm: take a title and a text for all pages.

    Attributes:
        values: of the parameters, by name.
    """

    def __init__(
        self,
        node: Node,
        controller: str,
        names: Sequence[str],
        services: dict[str, str],
        notify: Tell,
        alarm: Tell,
    ) -> None:
        self.values: dict[str, Any] = {}
        self._names, self._notify, self._alarm = list(names), notify, alarm
        self._wanted: dict[str, Any] = {}  # to be set: until that is confirmed
        self._calls: list[_Call] = []
        self._asked = -math.inf
        self._called = 0  # how often somebody called a service
        self._get = node.create_client(GetParameters, f"{controller}/get_parameters")
        self._set = node.create_client(SetParameters, f"{controller}/set_parameters")
        self._triggers = {
            name: node.create_client(Trigger, f"{owner}/{name}") for name, owner in services.items()
        }

    def want(self, name: str, number: int, given: Any) -> None:
        """Set a parameter, or element ``number`` of a list, if it is known."""
        known = self._wanted.get(name, self.values.get(name))
        if known is None:
            return
        is_list = isinstance(known, Sequence) and not isinstance(known, str)
        new = list(known) if is_list else [known]
        new[number] = given
        self._wanted[name] = new if is_list else given

    def call(self, *services: str) -> None:
        """Call services one after the other, each once the one before has succeeded.

        Those that are not called yet when somebody calls again are dropped.
        """
        self._called += 1
        self._call(services, self._called)

    def _call(self, services: tuple[str, ...], number: int) -> None:
        client, then = self._triggers[services[0]], partial(self._on_called, services, number)
        if client.service_is_ready():
            self._ask(client, Trigger.Request(), steady.now(), then)
        else:
            then(None)

    def forget(self) -> None:
        """Set nothing that is not set yet."""
        self._wanted.clear()

    def hear(self, now: float) -> None:
        """Take what services have answered, or not in time, ``now`` [s] being the last turn."""
        for call in self._calls[:]:
            if call.future.done() or now > call.until:
                self._calls.remove(call)
                call.client.remove_pending_request(call.future)
                call.then(call.future.result() if call.future.done() else None)

    def turn(self, now: float) -> None:
        """Set what is wanted, and ask for what there is."""
        busy = [call.client for call in self._calls]
        if self._wanted and not self._set.service_is_ready():
            self._wanted.clear()
            self._alarm("Not set", "The controller is not there.")
        if self._wanted and self._set not in busy:
            sent = dict(self._wanted)
            parameters = [_parameter(*entry).to_parameter_msg() for entry in sent.items()]
            request = SetParameters.Request(parameters=parameters)
            self._ask(self._set, request, now, partial(self._on_set, sent))
        due = now > self._asked + _ASK_EVERY and self._get not in busy
        if due and self._get.service_is_ready():
            self._asked = now
            request = GetParameters.Request(names=self._names)
            self._ask(self._get, request, now, self._on_parameters)

    def _ask(self, client: Any, request: Any, now: float, then: Callable[[Any], None]) -> None:
        self._calls.append(_Call(client, client.call_async(request), now + CONFIRMS, then))

    def _on_set(self, sent: dict[str, Any], answer: Any) -> None:
        if answer is None:
            text = f"{', '.join(sent)} was not confirmed within {CONFIRMS:g} s: it is sent again."
            self._alarm("Not set", text)
            return
        for (name, value), result in zip(sent.items(), answer.results, strict=True):
            if self._wanted.get(name) == value:
                del self._wanted[name]
            if result.successful:
                self.values = self.values | {name: value}
            else:
                self._notify("The controller refuses this", result.reason)
        self._asked = -math.inf  # ask what they are now

    def _on_parameters(self, answer: Any) -> None:
        if answer is not None:
            values = map(parameter_value_to_python, answer.values)
            self.values = dict(zip(self._names, values, strict=True))

    def _on_called(self, services: tuple[str, ...], number: int, answer: Any) -> None:
        name, *then = services
        what = "use the emergency stop." if name == "halt" and not then else "try again."
        if answer is None:
            self._alarm(f"No {name}", f"{name.capitalize()} was not confirmed: {what}")
        elif not answer.success:
            self._alarm(f"No {name}", f"{answer.message}: {what}")
        elif then and number == self._called:
            self._call(tuple(then), number)


def _parameter(name: str, value: Any) -> Parameter:
    if isinstance(value, list) and not value:
        return Parameter(name, Parameter.Type.DOUBLE_ARRAY, [])
    return Parameter(name, value=value)
