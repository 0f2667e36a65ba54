"""The nodes of schemes with the laws as shipped, for experiments."""

import os
from importlib import import_module


def prepare() -> None:
    """Register the laws as shipped; to be called before any law is imported.

    Formulas run as plain Python: those of this room are in no cache, and an experiment in lock-step
    waits.
    """
    os.environ["EULERPARAMS_PLAIN"] = "1"
    import_module("eulerparams_control.lab.as_shipped.laws")
    import_module("eulerparams_control.lab.as_shipped.pose")


def run(scheme: str) -> int:
    """Run the node of a scheme; return its exit code."""
    prepare()
    return int(import_module(f"eulerparams_control.ros.{scheme}_node").main())
