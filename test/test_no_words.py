"""No product file decides by the words of a message, of a log or of an error.

Words are for people and may be reworded.  Programs read the keys of /diagnostics, events on stdout,
exit codes, kinds of warnings and types of errors.
"""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FILES = sorted(
    path for name in ("eulerparams_control", "sim_bridge", "tools", "benchmarks")
    for path in (ROOT / name).rglob("*.py")
)  # fmt: skip

SPOKEN = {
    *("complaint", "complaints", "doing", "fault", "log", "logs", "message", "reason", "remedy"),
    *("said", "says", "stderr", "stdout", "warning", "warnings", "words"),
}
"""The last word of the names of what is said to people."""

METHODS = {
    *("startswith", "endswith", "count", "find", "rfind", "index", "rindex", "removeprefix"),
    *("removesuffix", "search", "match", "fullmatch", "findall", "finditer"),
}
"""Those that look for words in their object, or in their last argument."""

JUSTIFIED = {
    r'"\ndef main(" in path.read_text(encoding="utf-8")': "source code",
    "PRINTED not in name": "the names of residuals, made in the same file",
    're.split("[:;]", str(error), maxsplit=1)': "which complaints are alike, and are logged once",
    '"x" in chart.log': "the axes of a chart that are logarithmic",
    '"y" in chart.log': "the axes of a chart that are logarithmic",
}
"""What looks like words, and what it is."""


def constants(tree: ast.AST) -> Iterator[tuple[str, str]]:
    """Yield names and values of the strings that a module gives names to."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Assign):
            for target in node.targets:
                pair = isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple)
                names = target.elts if pair else [target]
                values = node.value.elts if pair else [node.value]
                for name, value in zip(names, values, strict=False):
                    if isinstance(name, ast.Name) and isinstance(value, ast.Constant):
                        yield name.id, str(value.value)


def is_of_words(node: ast.expr, named: dict[str, str]) -> bool:
    """Whether an expression is a text of words: a letter beside a space."""
    if isinstance(node, ast.JoinedStr):
        return any(is_of_words(part, named) for part in node.values)
    if isinstance(node, ast.Name | ast.Attribute):
        text = named.get(node.id if isinstance(node, ast.Name) else node.attr, "")
    else:
        text = node.value if isinstance(node, ast.Constant) else ""
    return isinstance(text, str) and re.search("[A-Za-z] | [A-Za-z]", text) is not None


def is_spoken(node: ast.expr, lines: frozenset[str] = frozenset()) -> bool:
    """Whether an expression is what somebody said, by its name, or an error as text.

    Args:
        node: the expression.
        lines: names of parts of what was said.
    """
    match node:
        case ast.Call(func=ast.Name(id="str" | "repr"), args=[ast.Name(id=name)]):
            return name in ("error", "exception", "e")
        case ast.Call(func=ast.Attribute(value=value, attr=attr)):
            return attr in SPOKEN or is_spoken(value, lines)
        case ast.Subscript(value=value, slice=ast.Constant(value=str(key))):
            return key in SPOKEN or is_spoken(value, lines)
        case ast.Name(id=name) | ast.Attribute(attr=name):
            return name in lines or name.lower().split("_")[-1] in SPOKEN
    return False


def parts(tree: ast.AST) -> frozenset[str]:
    """Return the names that go through the lines of what somebody said."""
    loops = (node for node in ast.walk(tree) if isinstance(node, ast.comprehension | ast.For))
    return frozenset(
        loop.target.id
        for loop in loops
        if isinstance(loop.target, ast.Name) and is_spoken(loop.iter)
    )


def matches(node: ast.AST, named: dict[str, str], lines: frozenset[str]) -> bool:
    """Whether an expression looks for words, or looks for something in what somebody said."""

    def is_said(part: ast.expr) -> bool:
        return is_spoken(part, lines)

    match node:
        case ast.Compare(left=left, ops=[ast.In() | ast.NotIn()], comparators=[right]):
            return is_of_words(left, named) or is_said(right)
        case ast.Compare(left=left, ops=[ast.Eq() | ast.NotEq()], comparators=[right]):
            words = is_of_words(left, named), is_of_words(right, named)
            return (is_said(left) and words[1]) or (is_said(right) and words[0])
        case ast.Call(func=ast.Attribute(value=ast.Name(id="re")), args=[pattern, *rest]):
            return is_of_words(pattern, named) or any(map(is_said, rest))
        case ast.Call(func=ast.Attribute(value=value, attr=attr), args=args) if attr in METHODS:
            return any(is_of_words(arg, named) for arg in args) or any(map(is_said, [value, *args]))
    return False


def found(source: str, named: dict[str, str]) -> list[str]:
    """Return the expressions of a source that decide by words."""
    tree = ast.parse(source)
    named = named | dict(constants(tree))
    told = {
        id(node.value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Expr) and ast.unparse(node).split("(")[0].endswith(".count")
    }  # a counter that is counted up
    nodes, lines = (node for node in ast.walk(tree) if id(node) not in told), parts(tree)
    return [ast.unparse(node) for node in nodes if matches(node, named, lines)]


def test_no_product_file_decides_by_words():
    sources = {path: path.read_text() for path in FILES}
    named = {
        name: value for source in sources.values() for name, value in constants(ast.parse(source))
        if name.isupper()
    }  # fmt: skip
    caught = {
        text.replace("'", '"'): str(path.relative_to(ROOT))
        for path, source in sources.items()
        for text in found(source, named)
    }
    assert {text: path for text, path in caught.items() if text not in JUSTIFIED} == {}
    assert caught.keys() >= JUSTIFIED.keys()  # it sees what looks like words


@pytest.mark.parametrize(
    ("source", "decides"),
    [
        ('A, B = "following a reference", "slow"\nA in self.message and B in self.message', True),
        ('restarted = controller.resets and "after a" in doing', True),
        ('NOTHING, ACTIVE = "no commands until", "active with"\nif NOTHING in message: pass', True),
        ("while self.log(executable).count(words) < times: pass", True),
        ("if BEYOND.search(said): pass", True),
        ('BEYOND = re.compile(r"not finite|must be \\d+ finite numbers")', True),
        ('errors = [line for line in self.log(name).splitlines() if "[ERROR]" in line]', True),
        ('return lambda line: line["who"] == who and words in line["says"]', True),
        ('if status.message == "no valid joint_states": pass', True),
        ('if "timed out" in str(error): pass', True),
        ('BEGAN = "reference began at [ns]"\nvalue.key == BEGAN', False),
        ('line.startswith("{")', False),
        ("name in topics and status.mode == Mode.STOPPED", False),
        ('say(console, f"warning: {digest.warning}")', False),
        ("self._said.get(node) != report", False),
    ],
)
def test_what_decides_by_words_is_caught_and_what_reads_keys_is_not(source, decides):
    assert bool(found(source, {})) == decides
