"""Work of the elastic moments along a closed path of 30 deg, K_o = diag(50, 20, 5) Nm/rad."""

import numpy as np

import eulerparams_control.lab.as_shipped.laws  # noqa: F401  registers its laws
from eulerparams_control.analysis.charts import Chart, Line
from eulerparams_control.lab.experiments.library import Number, Result
from eulerparams_control.laws.orientation import ORIENTATIONS, representation
from eulerparams_control.laws.rotations import Array, exp, log

SHIPPED = ("as_shipped_eps", "as_shipped_theta", "as_shipped_sin", "as_shipped_geometric")
K_O = np.diag([50.0, 20.0, 5.0])
STEPS = 1000


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
    drawn = ("euler_parameters", "rotation_vector", *SHIPPED[:3])
    lines = [
        Line(name, tuple(zip(t[1::10].tolist(), np.cumsum(done[name])[::10].tolist(), strict=True)))
        for name in drawn
    ]
    return Result(numbers, Chart("path [rad]", "work on the arm so far [J]", tuple(lines)))


def closed_path() -> list[Array]:
    """Return the rotations (3, 3) of the path."""
    t = np.linspace(0.0, 2 * np.pi, STEPS + 1)
    a = np.array([np.cos(t) + 0.3, np.sin(t) - 0.2, 0.5 * np.sin(t + 0.7) + 0.6]).T
    return [exp(x) for x in np.radians(30.0) * a]


def work(name: str, path: list[Array]) -> Array:
    """Return the work (N,) [J] done against the spring of a law between rotations, R_d = I."""
    law = representation(name)
    mu = [-law.spring(np.eye(3), R, K_O, law.options.values).moment for R in path]
    steps = [(mu[i] + mu[i + 1]) / 2 @ log(path[i + 1] @ path[i].T) for i in range(len(path) - 1)]
    return np.array(steps)
