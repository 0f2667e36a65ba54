"""Work of the elastic moments along a closed path of 30 deg, K_o = diag(50, 20, 5) Nm/rad.

As the path is, and where a hand, a torsion spring, leads a tool around it, out and back: there the
moments of hand and law balance each other, K_o = diag(20, 8, 2) Nm/rad.
"""

import numpy as np

import eulerparams_control.lab.as_shipped.laws  # noqa: F401  registers its laws
from eulerparams_control.analysis.charts import Chart, Line
from eulerparams_control.lab.experiments.library import Number, Result
from eulerparams_control.lab.experiments.library._rest import at_rest
from eulerparams_control.laws.orientation import ORIENTATIONS, representation
from eulerparams_control.laws.rotations import Array, exp, log

SHIPPED = ("as_shipped_eps", "as_shipped_theta", "as_shipped_sin", "as_shipped_geometric")
K_O, K_LED = np.diag([50.0, 20.0, 5.0]), np.diag([20.0, 8.0, 2.0])
STEPS, OUT = 1000, 50
HANDS = {"contact": 500.0, "guided": 40.0}
"""The experiments with a hand, and its stiffness [Nm/rad]."""


def run() -> Result:
    """Return the work that each law takes, and what it exchanges."""
    t = np.linspace(0.0, 2 * np.pi, STEPS + 1)
    path = closed_path()
    done = {name: work(name, path) for name in (*ORIENTATIONS, *SHIPPED)}
    numbers = {name: Number(float(done[name].sum()), f"work, {name}", "J") for name in SHIPPED}
    numbers |= {
        "exchanged": Number(float(np.abs(done[SHIPPED[0]]).sum()), "exchanged, K 2 eps", "J"),
        "gradients": Number(
            max(abs(float(done[name].sum())) for name in (*ORIENTATIONS, SHIPPED[-1])),
            "largest work of a representation",
            "J",
        ),
        "back": Number(float(work(SHIPPED[0], path[::-1]).sum()), "K 2 eps, other way", "J"),
    }
    for hand, stiffness in HANDS.items():
        for name in SHIPPED[:3]:
            made = -float(work(name, led(name, stiffness), K_LED).sum())
            text = f"energy that {name} makes, led by {stiffness:g} Nm/rad"
            numbers[f"{hand}_{name.removeprefix('as_shipped_')}"] = Number(made, text, "J")
    drawn = ("euler_parameters", "rotation_vector", *SHIPPED[:3])
    lines = [Line(name, np.column_stack((t[1:], np.cumsum(done[name])))[::10]) for name in drawn]
    return Result(numbers, Chart("path [rad]", "work on the arm so far [J]", tuple(lines)))


def closed_path() -> list[Array]:
    """Return the rotations (3, 3) of the path."""
    return [exp(x) for x in _vectors()]


def _vectors() -> Array:
    t = np.linspace(0.0, 2 * np.pi, STEPS + 1)
    a = np.array([np.cos(t) + 0.3, np.sin(t) - 0.2, 0.5 * np.sin(t + 0.7) + 0.6]).T
    return np.radians(30.0) * a


def led(name: str, stiffness: float) -> list[Array]:
    """Return where a tool is that a hand leads around the path: K log(R_a R') is -mu of the law."""
    law, around = representation(name), _vectors()[::4]
    out = np.linspace(0.0, 1.0, OUT)[:, None] * around[0]
    R, found = np.eye(3), []
    for R_a in map(exp, np.vstack([out, around, out[::-1]])):

        def mu(R: Array, R_a: Array = R_a) -> Array:
            spring = law.spring(np.eye(3), R, K_LED)
            moment: Array = spring.moment + stiffness * log(R_a @ R.T)
            return moment

        R = at_rest(mu, R)
        found.append(R)
    return found


def work(name: str, path: list[Array], K_o: Array = K_O) -> Array:
    """Return the work (N,) [J] done against the spring of a law between rotations, R_d = I."""
    law = representation(name)
    mu = [-law.spring(np.eye(3), R, K_o).moment for R in path]
    steps = [(mu[i] + mu[i + 1]) / 2 @ log(path[i + 1] @ path[i].T) for i in range(len(path) - 1)]
    return np.array(steps)
