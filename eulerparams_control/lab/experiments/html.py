"""Pieces of pages: the sheet, equations, criteria; all that comes from files is escaped."""

import re
from collections.abc import Iterable
from html import escape

from eulerparams_control.analysis.verdict import Verdict, VerdictGroup, groups, shown
from eulerparams_control.lab.experiments.equations import equation

MISSING = "-"
NOT_JUDGED = "not judged"

_FEW = 3  # runs that are named each, even if they are the same

_STYLE = """
:root { --text: #1b1f24; --soft: #5b6470; --line: #d5dae0; --ground: #ffffff; --raised: #f4f6f8;
  --yes: #00734f; --no: #b3261e; --link: #0b5cad; }
@media screen and (prefers-color-scheme: dark) {
  :root { --text: #e6e9ec; --soft: #a2abb5; --line: #3a424b; --ground: #14171b; --raised: #1d2227;
    --yes: #3ecf9c; --no: #ff8a80; --link: #7db7f5; color-scheme: dark; }
  .picture svg { filter: invert(1) hue-rotate(180deg); } }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 1120px; padding: 24px 28px 64px; color: var(--text);
  background: var(--ground); font: 15px/1.5 system-ui, "Segoe UI", Roboto, "Noto Sans",
  "Liberation Sans", sans-serif; }
h1 { font-size: 25px; line-height: 1.3; font-weight: 600; margin: 0 0 8px; max-width: 44em;
  text-wrap: balance; }
h2 { font-size: 18px; font-weight: 600; margin: 40px 0 8px; }
section { border-top: 1px solid var(--line); margin-top: 36px; padding-top: 20px; }
section h2 { margin: 0 0 6px; max-width: 48em; }
p { margin: 0 0 8px; max-width: 72em; overflow-wrap: anywhere; }
a { color: var(--link); }
.soft { color: var(--soft); }
.small { font-size: 13px; line-height: 1.45; }
.yes { color: var(--yes); font-weight: 600; white-space: nowrap; }
.no { color: var(--no); font-weight: 600; }
.warning { border-left: 4px solid var(--no); background: var(--raised); padding: 8px 12px;
  white-space: pre-wrap; overflow-wrap: anywhere; font-size: 13px; }
.columns { display: grid; grid-template-columns: minmax(0, 1fr) minmax(0, 460px); gap: 8px 32px;
  align-items: start; margin: 12px 0; }
.picture svg { width: 100%; height: auto; display: block; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; font-size: 14px; font-variant-numeric: tabular-nums; }
th, td { padding: 5px 16px 5px 0; text-align: left; vertical-align: top;
  border-bottom: 1px solid var(--line); }
th { font-weight: 600; }
td.number, .whole { white-space: nowrap; }
dl { display: grid; grid-template-columns: max-content minmax(0, 1fr); gap: 3px 12px; margin: 0; }
dt { color: var(--soft); } dd { margin: 0; }
.math { font-family: "STIX Two Text", "Cambria Math", Cambria, Georgia, "Liberation Serif",
  "DejaVu Serif", serif; }
.math sub { font-size: 0.72em; line-height: 0; }
.wrong { color: var(--soft); font-size: 13px; }
pre, code { font: 13px/1.5 ui-monospace, "Cascadia Mono", Menlo, Consolas, "DejaVu Sans Mono",
  monospace; }
code { background: var(--raised); border-radius: 3px; padding: 1px 5px; overflow-wrap: anywhere; }
@media (max-width: 860px) { .columns { grid-template-columns: minmax(0, 1fr); } }
@media print {
  body { padding: 0; max-width: none; font-size: 9.5pt; } a { color: inherit; }
  h1 { font-size: 15pt; } h2 { font-size: 12pt; break-after: avoid; }
  section { break-inside: avoid; } tr { break-inside: avoid; } .scroll { overflow: visible; }
  table { font-size: 8pt; } th, td { padding: 3px 9px 3px 0; }
  .small, .wrong, code { font-size: 7.5pt; }
  .columns { grid-template-columns: minmax(0, 1fr) 46%; }
  * { print-color-adjust: exact; } }
"""

_POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"

_SUBSCRIPT = re.compile(r"_([A-Za-z0-9]+)")


def page(title: str, body: Iterable[str]) -> str:
    """Return a whole page, which loads nothing; ``body`` is HTML."""
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>{_STYLE}</style>\n</head>\n<body>\n"
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
