"""The controllers that ran, and their settings, from the parameters in a bag."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from eulerparams_control.errors import BagError, ConfigurationError
from eulerparams_control.laws.orientation import OrientationOptions
from eulerparams_control.parameters.common import ControlParameters
from eulerparams_control.parameters.fields import fields_of, from_mapping
from eulerparams_control.parameters.schemes import schemes

type Parameters = Mapping[str, Mapping[str, Any]]
"""By node and name."""

_ORIENTATION = ("euler_sequence", "quaternion_sign", "hysteresis", "quaternion_initial_sign")


def recorded[P: ControlParameters](
    parameters: Parameters, kind: type[P], needed: tuple[str, ...] = ()
) -> P | None:
    """Return the parameters of the first controller with a kind of them; None if none ran.

    Names that it has not are those of another version, and are left out.

    Args:
        parameters: of the recorded nodes.
        kind: of parameters.
        needed: names that have no default here, where the controller has them.

    Raises:
        BagError: if they are impossible, or one that is needed was not recorded.
    """
    for node, values in parameters.items():
        scheme = schemes().get(node.rsplit("/", 1)[-1])
        if scheme is None or not issubclass(scheme.parameters, kind):
            continue
        known = fields_of(scheme.parameters)
        if lacking := [name for name in needed if name in known and name not in values]:
            raise BagError(f"the parameters of {node} lack {', '.join(lacking)}")
        with parameters_to_blame(node):
            return from_mapping(scheme.parameters, {n: values[n] for n in known if n in values})
    return None


@contextmanager
def parameters_to_blame(node: str) -> Iterator[None]:
    """Turn each ConfigurationError into a BagError that names the node."""
    try:
        yield
    except ConfigurationError as error:
        raise BagError(f"the parameters of {node} are not valid: {error}") from error


def options_of(parameters: Parameters) -> OrientationOptions:
    """Return the options of the controller's representation; the defaults if none ran.

    Raises:
        ConfigurationError: if that is impossible.
    """
    keys = {"orientation", "euler_sequence"}
    node = next((values for values in parameters.values() if keys & values.keys()), {})
    told = {name: node[name] for name in _ORIENTATION if name in node}
    return from_mapping(ControlParameters, told).orientation_options()
