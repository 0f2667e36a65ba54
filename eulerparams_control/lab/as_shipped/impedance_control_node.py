"""The node ``impedance_control`` with the laws as shipped: no executable."""

import sys

from eulerparams_control.lab.as_shipped.node import run

if __name__ == "__main__":
    sys.exit(run("impedance_control"))
