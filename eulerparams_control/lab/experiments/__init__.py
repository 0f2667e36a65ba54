"""Experiments: YAML files that define runs, and the code that runs and judges them."""

import eulerparams_control.lab.as_shipped.laws  # noqa: F401  bags may be of its laws
