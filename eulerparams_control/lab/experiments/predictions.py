"""Predictions of theory for a quantity over time, as an experiment's file states them.

    predictions:
      - {quantity: moment, text: "50 sin(theta) = 500 (10 deg - theta)", value: 7.903}
      - {quantity: force, text: ..., points: [[0.0, 0.0], [1.0, 9.52]]}
      - {quantity: orientation_error, text: (41), form: error_41,
         options: {error: 30.0, k_Po: 100.0, k_Vo: 14.142}}
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from eulerparams_control.analysis.charts import picture
from eulerparams_control.analysis.quantities.base import Prediction
from eulerparams_control.lab.experiments.yaml_checks import (
    check_call,
    is_number,
    known,
    points,
    require,
)
from eulerparams_control.laws.rotations import Array

_STEP = 2e-3  # [s] of the integration of a form
_KEYS = ("quantity", "text", "value", "points", "form", "options")


@dataclass(frozen=True)
class Predicted:
    """A curve that theory predicts.

    Attributes:
        quantity: its name.
        text: what it is, with its equation.
        points: (t, y) of its corners [s]; () if it is a form.
        form: name in ``FORMS``; "" if it has corners.
        options: of the form.
    """

    quantity: str
    text: str
    points: tuple[tuple[float, float], ...] = ()
    form: str = ""
    options: dict[str, float] = field(default_factory=dict)

    def over(self, duration: float) -> Prediction:
        """Return the curve from 0 to ``duration`` [s]."""
        if self.form:
            t, y = FORMS[self.form](duration, **self.options)
        else:
            t, y = np.array(self.points).T
            if len(t) == 1:
                t, y = np.array([0.0, duration]), np.repeat(y, 2)
        return Prediction(self.quantity, self.text, t, y)


def error_41(duration: float, error: float, k_Po: float, k_Vo: float) -> tuple[Array, Array]:
    """Return t [s] and the orientation error [deg] of (41), from ``error`` [deg] at rest.

    About a fixed axis (41) is theta'' = -k_Vo theta' - k_Po sin(theta / 2); an error of more
    than 180 deg is one with eta < 0, which is undone the long way.
    """

    def rate(y: Array) -> Array:
        return np.array([y[1], -k_Vo * y[1] - k_Po * math.sin(y[0] / 2)])

    t = np.arange(0.0, duration + _STEP / 2, _STEP)
    y, theta = np.array([math.radians(error), 0.0]), np.empty(len(t))
    for i in range(len(t)):
        theta[i] = y[0]
        a = rate(y)
        b = rate(y + _STEP / 2 * a)
        c = rate(y + _STEP / 2 * b)
        y = y + _STEP / 6 * (a + 2 * b + 2 * c + rate(y + _STEP * c))
    return t, np.degrees(np.minimum(np.abs(theta), np.abs(2 * math.pi - theta)))


FORMS: dict[str, Callable[..., tuple[Array, Array]]] = {"error_41": error_41}
"""Curves that follow from an equation, by name."""


def parse_prediction(content: Any) -> Predicted:
    """Return a prediction from YAML; raises ConfigurationError."""
    require(isinstance(content, dict), "predictions: expected quantity, text and a value")
    for key in content:
        known("key of a prediction", key, _KEYS)
    for key in ("quantity", "text"):
        require(key in content, f"predictions: the key '{key}' is missing")
    quantity, text = picture(str(content["quantity"])).name, str(content["text"])
    kinds = [key for key in ("value", "points", "form") if key in content]
    require(len(kinds) == 1, "predictions: expected one of 'value', 'points' and 'form'")
    if kinds == ["points"]:
        return Predicted(quantity, text, points("predictions: points", content["points"]))
    if kinds == ["value"]:
        require(is_number(content["value"]), "predictions: value: expected a number")
        return Predicted(quantity, text, ((0.0, float(content["value"])),))
    return _form(quantity, text, str(content["form"]), content.get("options") or {})


def _form(quantity: str, text: str, name: str, options: Any) -> Predicted:
    known("form of a prediction", name, FORMS)
    check_call(f"the form '{name}'", FORMS[name], options)
    require(all(map(is_number, options.values())), f"options of the form '{name}': numbers")
    return Predicted(quantity, text, form=name, options={k: float(v) for k, v in options.items()})
