"""Pieces of pages: the sheet, equations, criteria; all that comes from files is escaped."""

import re
from collections.abc import Iterable
from html import escape

from eulerparams_control.analysis.page_assets import style
from eulerparams_control.analysis.verdict import Verdict, VerdictGroup, groups, shown
from eulerparams_control.lab.experiments.equations import equation

MISSING = "-"
NOT_JUDGED = "not judged"

_FEW = 3  # runs that are named each, even if they are the same

_POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"

_SUBSCRIPT = re.compile(r"_([A-Za-z0-9]+)")


def page(title: str, body: Iterable[str], policy: str = _POLICY) -> str:
    """Return a whole page, which loads nothing; ``body`` is HTML, ``policy`` what may run."""
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>{style('plain.css')}</style>\n</head>\n<body>\n"
        + "\n".join(body)
        + "\n</body>\n</html>\n"
    )


def mathematics(text: str) -> str:
    """Return an equation with its subscripts."""
    escaped = escape(text, quote=False)
    return f'<span class="math">{_SUBSCRIPT.sub(r"<sub>\1</sub>", escaped)}</span>'


def equations(numbers: Iterable[str]) -> str:
    """Return equations with what is printed where the print is wrong; references below them."""
    all_of_them = [equation(number) for number in numbers]
    rows = []
    for found in (one for one in all_of_them if one.text):
        wrong = (
            f'<div class="wrong">the paper prints {mathematics(found.printed)}</div>'
            if found.printed
            else ""
        )
        rows.append(f"<dt>{escape(found.number)}</dt><dd>{mathematics(found.text)}{wrong}</dd>")
    references = ", ".join(one.number for one in all_of_them if not one.text)
    see = f'<p class="soft small">See {escape(references)} of the paper.</p>' if references else ""
    return (f"<dl>{''.join(rows)}</dl>" if rows else "") + see


def criteria(verdicts: Iterable[Verdict]) -> str:
    """Return the table of criteria: what was predicted, measured, asked for."""
    names = ("criterion", "of", "predicted", "measured", "bound", "")
    return table(names, map(_criterion, groups(list(verdicts))))


def table(names: Iterable[str], rows: Iterable[str]) -> str:
    """Return a table; the cells of its rows are HTML."""
    head = "".join(f"<th>{escape(name)}</th>" for name in names)
    body = "".join(f"<tr>{row}</tr>" for row in rows)
    return (
        f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>'
        "</div>"
    )


def cells(row: Iterable[str]) -> str:
    """Return the cells of a row; their content is HTML."""
    return "".join(f"<td>{content}</td>" for content in row)


def _criterion(group: VerdictGroup) -> str:
    """Return the row of a criterion, with a line for each run; one for many that are the same."""
    verdicts = group.verdicts
    of = [escape(verdict.variant).replace("_", "_<wbr>") for verdict in verdicts]
    values = [escape(shown(verdict)) for verdict in verdicts]
    met = [mark(verdict.met) for verdict in verdicts]
    if len(verdicts) > _FEW and len({*zip(values, met, strict=True)}) == 1:
        of, values, met = [f"{len(verdicts)} runs"], values[:1], met[:1]
    return (
        f"<td>{escape(group.first.text)}</td><td>{'<br>'.join(of)}</td>"
        f"<td>{escape(group.first.predicted or MISSING)}</td>"
        f'<td class="number">{"<br>".join(values)}</td>'
        f'<td class="number">{escape(bound(group.first))}</td><td>{"<br>".join(met)}</td>'
    )


def bound(verdict: Verdict) -> str:
    """Return the bounds of a verdict with their unit."""
    return f"{verdict.bound} {verdict.unit}".rstrip()


def mark(met: bool) -> str:
    """Return whether something holds."""
    return '<span class="yes">✓ met</span>' if met else '<span class="no">✗ not met</span>'


def picture(figure: str, why: str) -> str:
    """Return a figure, made by us as SVG, or why there is none."""
    if not figure:
        return f'<p class="soft small">No figure: {escape(why)}.</p>'
    return f'<div class="picture">{figure}</div>'
