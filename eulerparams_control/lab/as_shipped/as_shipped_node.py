"""The node ``compliance_control`` with the laws as shipped, for experiments: no executable.

Formulas run as plain Python: those of this room are in no cache, and an experiment in lock-step
waits.
"""

import os
import sys
from unittest.mock import patch


def run() -> int:
    """Run the node; return its exit code."""
    os.environ["EULERPARAMS_PLAIN"] = "1"  # before the laws are imported
    import eulerparams_control.lab.as_shipped.laws  # noqa: F401  registers them
    from eulerparams_control.ros import compliance_control_node, managed_node

    with patch.object(managed_node, "ORIENTATIONS", ()):  # none is changed to, so none is loaded
        return compliance_control_node.main()


if __name__ == "__main__":
    sys.exit(run())
