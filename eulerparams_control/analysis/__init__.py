"""From bags to numbers and figures, without ROS.

```python
from eulerparams_control import analysis

run = analysis.load("out/demo/clik_euler_parameters")
run.leading.t, run.leading.orientation_error              # (N,) [s], (N,) [rad]
analysis.measure("peak_orientation_error", run)           # [deg], as in the table
analysis.columns(run)["orientation_error [deg]"]            # all quantities, named with units
analysis.figure([run], "orientation_error").savefig("error.pdf")
```
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from eulerparams_control.analysis.digest import Digest
from eulerparams_control.analysis.export import columns
from eulerparams_control.analysis.loading import load
from eulerparams_control.analysis.quantities import BY_NAME, METRICS, measure
from eulerparams_control.analysis.recording import Recording
from eulerparams_control.errors import UnknownNameError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["METRICS", "Digest", "Recording", "columns", "figure", "load", "measure"]


def figure(runs: Sequence[Recording], quantity: str) -> "Figure":
    """Return a quantity of runs over time as a figure for a paper, one column wide.

    Args:
        runs: laid over each other.
        quantity: its name, such as ``orientation_error``; see ``quantities.BY_NAME``.

    Raises:
        UnknownNameError: if there is none of that name; lists those that exist.
        ConfigurationError: if no run has it.
    """
    from eulerparams_control.analysis.static import quantity_figure  # matplotlib takes a second

    if quantity not in BY_NAME:
        raise UnknownNameError("quantity", quantity, BY_NAME)
    return quantity_figure(list(map(Digest.of, runs)), BY_NAME[quantity])
