"""Experiments: YAML files that define runs, and the code that runs and judges them."""

import eulerparams_control.lab.as_shipped.laws
import eulerparams_control.lab.as_shipped.pose  # noqa: F401  bags may be of their laws
