"""Commands of every law and representation, asked for all there is, in a file: FILE."""

import sys

import numba.core.event
import numpy as np
from yardstick import LAWS, REPRESENTATIONS, Product, Script, arm_named, circle


class Compilations(numba.core.event.Listener):
    """Counts what numba compiles."""

    count = 0

    def on_start(self, event):
        self.count += 1

    def on_end(self, event):
        """Nothing is counted at the end."""


def commands(law, orientation):
    """Return the commands along a circle, of a stream, to a pose, by a twist, and in a halt."""
    arm = arm_named("ur5")
    script = Script(arm, 11, arm.home)
    other = REPRESENTATIONS[REPRESENTATIONS.index(orientation) - 1]
    script.go(8, "follow", *circle(script.pose, 0.1, 2.0, 0.4))
    script.go(4, "change", {"orientation": other, "max_linear_speed": 0.05})
    script.go(4, "stream", *script.pose)
    script.go(4, "aim", *script.pose)
    script.go(4, "jog", np.array([0.05, 0.0, 0.0, 0.0, 0.2, 0.0]))
    script.go(5, "halt")
    product, rows = Product(law, arm, {"orientation": orientation}, arm.home), []
    for tick in script.ticks:
        product.at(tick.receipt)
        assert all(product.order(*order) for order in tick.orders)
        rows.append(product.step(tick))
        assert not product.controller.fault
    return np.array(rows)


if __name__ == "__main__":
    compilations = Compilations()
    with numba.core.event.install_listener("numba:compile", compilations):
        found = {f"{law} {name}": commands(law, name) for law in LAWS for name in REPRESENTATIONS}
    np.savez(sys.argv[1], compilations=compilations.count, **found)
