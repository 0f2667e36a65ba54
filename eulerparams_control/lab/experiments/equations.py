"""The paper's equations as text, as they hold, and what is printed where the print is wrong.

    equation("(28)").text       # the law
    equation("(38)").printed    # which of its terms is wrong

They are in ``config/paper/equations.yaml``.
"""

from functools import cache
from typing import NamedTuple

import yaml

from eulerparams_control.errors import UnknownNameError
from eulerparams_control.resources import config_file


class Equation(NamedTuple):
    """An equation of the paper.

    Attributes:
        number: as the paper has it, such as ``(28)``.
        text: as it holds.
        printed: what the paper prints instead, or what it leaves out; "" if it is right.
    """

    number: str
    text: str
    printed: str = ""


@cache
def _all() -> dict[int, dict[str, str]]:
    text = config_file("paper", "equations").read_text(encoding="utf-8")
    return dict(yaml.safe_load(text))


def equation(number: str) -> Equation:
    """Return an equation by its number, such as ``(28)``; a reference is returned as it is.

    Raises:
        UnknownNameError: if the paper has no such equation, or it is not written out here.
    """
    inner = number.strip("()")
    if not inner.isdigit():
        return Equation(number, "")
    if int(inner) not in _all():
        raise UnknownNameError("equation", number, (f"({n})" for n in _all()))
    return Equation(number, **_all()[int(inner)])
