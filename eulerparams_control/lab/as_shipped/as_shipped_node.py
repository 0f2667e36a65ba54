"""The node ``compliance_control`` with the laws of ``as_shipped``, for experiments only.

Formulas run as plain Python: those of this room are in no cache, and an experiment in lock-step
waits.
"""

import os
import sys
from unittest.mock import patch


def main(args: list[str] | None = None) -> int:
    """Run the node."""
    os.environ["EULERPARAMS_PLAIN"] = "1"  # before the laws are imported
    import eulerparams_control.lab.as_shipped  # noqa: F401  registers them
    from eulerparams_control.ros import compliance_control_node, managed_node

    with patch.object(managed_node, "ORIENTATIONS", ()):  # none is changed to, so none is loaded
        return compliance_control_node.main(args)


if __name__ == "__main__":
    sys.exit(main())
