"""Numbers of a run that a criterion can be put on; importing this registers them.

Each takes a Recording and keyword options from the experiment's YAML, and returns one
number in the unit that its registration names; a new one is one function.  What was not
recorded raises BagError.  Options that many have:

``of``  what it looks at: the ``command`` (joint_reference), the motion that was ``measured``
    (joint_states), or the ``leading`` of them, which is the default: the command if there
    is one, as with kinematic control, else the measured motion, as with dynamic control.
``after``, ``before``  [s] the time that it looks at, both ends included.
``against``  what an error is measured from: the ``desired`` frame or the ``compliant`` one.
``axis``, ``frame``, ``window``  of vectors: see ``contact``.
"""

from eulerparams_control.analysis.metrics import (
    compliant_frame,
    contact,
    errors,
    motion,
    raw_messages,
    real_time,
    stability,
)
from eulerparams_control.analysis.metrics.base import METRICS, Metric, get_metric, measure, quotient

__all__ = [
    "METRICS",
    "Metric",
    "compliant_frame",
    "contact",
    "errors",
    "get_metric",
    "measure",
    "motion",
    "quotient",
    "raw_messages",
    "real_time",
    "stability",
]
