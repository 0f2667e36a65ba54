"""The nodes of schemes with the laws as shipped, for experiments."""

from importlib import import_module


def prepare() -> None:
    """Register the laws as shipped; to be called before the parameters of a node are declared."""
    import_module("eulerparams_control.lab.as_shipped.laws")
    import_module("eulerparams_control.lab.as_shipped.pose")


def run(scheme: str) -> int:
    """Run the node of a scheme; return its exit code."""
    prepare()
    return int(import_module(f"eulerparams_control.ros.{scheme}_node").main())
