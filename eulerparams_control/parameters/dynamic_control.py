"""Parameters of the node ``dynamic_control``."""

from dataclasses import dataclass

from eulerparams_control.parameters.efforts import EffortParameters


@dataclass(frozen=True)
class DynamicParameters(EffortParameters):
    """Parameters of the node ``dynamic_control``: those of its inverse dynamics."""
