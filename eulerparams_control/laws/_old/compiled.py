"""Compiled formulas: written once, for one sample, and mapped over many.

``@formula`` marks what the laws are made of, plain Python on values: numbers, vectors, matrices
(:mod:`.linear`), and NamedTuples of these.  ``@entry`` marks what Python
calls with arrays.  Its types are fixed by its annotations, so that nothing is compiled while an
arm moves.  Where numba is installed both are compiled; else, or with EULERPARAMS_PLAIN=1 in the
environment, the same source runs as it is, 20 to 50 times slower.

A formula takes arrays, too: of one sample, for which it runs as it is, or of N samples in a row,
for which it is compiled at the first call, and mapped.  What it calls ``previous`` is then its own
value for the sample before.
"""

import atexit
import hashlib
import importlib.util
import inspect
import os
import shutil
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import cache, cached_property, update_wrapper, wraps
from pathlib import Path
from types import FunctionType
from typing import Annotated, Any, NamedTuple, cast, get_args, get_type_hints

import numpy as np
from numpy.typing import NDArray


class NotCompiledError(Exception):
    """Of this room."""


Array = NDArray[np.float64]

_IS_PLAIN = bool(os.environ.get("EULERPARAMS_PLAIN"))
IS_COMPILED = not _IS_PLAIN and bool(importlib.util.find_spec("numba"))
"""Whether formulas are compiled."""

if not (IS_COMPILED or _IS_PLAIN):
    warnings.warn(
        "numba is not installed: formulas run as plain Python, 20 to 50 times slower; install it "
        "(pip install numba), or set EULERPARAMS_PLAIN=1 if that is meant",
        stacklevel=2,
    )

# What an entry takes and fills: rows of floats in a row, and what it only reads, however it lies.
Row = Annotated[Array, "float64", 1, "C", False]
Rows = Annotated[Array, "float64", 2, "C", False]
Input = Annotated[Array, "float64", 1, "A", True]
Inputs = Annotated[Array, "float64", 2, "A", True]
Bytes = Annotated[NDArray[np.uint8], "uint8", 1, "C", True]
Places = Annotated[NDArray[np.int64], "int64", 2, "C", True]

NONE: Array = np.empty(0)
"""Placeholder for a row that is not there."""

of_parts = tuple.__new__
"""Makes a NamedTuple of all its parts, in half the time of a call of its class."""

# Where formulas are: where a file changes, all is compiled again.
_NAMES = "laws", "robot", "motion", "control"
_ROOMS = tuple(Path(__file__).parents[2] / room for room in _NAMES)
_KEPT = 14 * 86400.0  # [s] that what is compiled for a state of these files stays unused

if IS_COMPILED:
    import numba
    import numba.core.compiler_lock
    import numba.core.event
    import numba.extending

_ATOMS: dict[type, tuple[str, ...]] = {}  # kinds of values that are a row of floats


# --- kinds of values: how they lie in a row of floats --------------------------------------


class Kernel:
    """A function that is compiled where a compiled one calls it."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function = function
        update_wrapper(self, function)

    def __call__(self, *args: Any) -> Any:
        """Return what the function returns."""
        return self.function(*args)

    @cached_property
    def compiled(self) -> Any:
        """The function as numba has it."""
        return _njit(self.function)


class RowLayout(NamedTuple):
    """How a kind of value lies in a row of floats.

    Attributes:
        width: how many floats it is.
        read: returns the value (a, i) that begins at a[i].
        put: writes a value (a, i, v) from a[i] on.
        pack: returns a row with a value whose parts are arrays.
        unpack: returns the value of a row, whose parts are arrays: views of it.
    """

    width: int
    read: Kernel
    put: Kernel
    pack: Callable[[Any], Array]
    unpack: Callable[[Array], Any]


@cache
def layout(kind: Any) -> RowLayout:
    """Return the layout of a kind: a number, an atom, or a tuple of kinds, named or not."""
    leaves, names = list(_leaves(kind, "v")), dict[str, Any](empty=np.empty)
    made, _ = _making(kind, 0, names)
    views, _ = _making(kind, 0, names, as_views=True)
    fills = "".join(f"    {line}\n" for line in _fills(kind, "v", iter(range(len(leaves) + 1))))
    writes = "".join(f"    a[i + {k}] = {leaf}\n" for k, leaf in enumerate(leaves))
    name = hashlib.sha256(f"{kind}{leaves}".encode()).hexdigest()[:8]
    read = _source(f"read_{name}", f"(a, i):\n    return {made}\n", names)
    put = _source(f"put_{name}", f"(a, i, v):\n{writes}", names)
    fills = f"    a = empty({len(leaves)})\n{fills}    return a\n"
    pack = _source(f"pack_{name}", f"(v):\n{fills}", names)
    unpack = _source(f"unpack_{name}", f"(a):\n    return {views}\n", names)
    return RowLayout(len(leaves), Kernel(read), Kernel(put), pack, unpack)


@cache
def _parts(kind: Any) -> list[tuple[str, Any]]:
    """Return how the parts of a kind are reached, and their kinds; none of a number."""
    if kind in _ATOMS:
        return [(f".{name}", float) for name in _ATOMS[kind]]
    if hasattr(kind, "_fields"):
        hints = get_type_hints(kind, include_extras=True)
        return [(f".{name}", _plain(part)) for name, part in hints.items()]
    return [(f"[{k}]", part) for k, part in enumerate(get_args(kind))]


def _plain(part: Any) -> Any:
    """Return the kind of a field that is an array outside of formulas."""
    return getattr(getattr(part, "__value__", part), "__metadata__", (part,))[0]


def _leaves(kind: Any, name: str) -> Iterable[str]:
    parts = _parts(kind)
    for path, part in parts:
        yield from _leaves(part, name + path)
    if not parts:
        yield f"1.0 * {name}" if kind is not float else name


def _making(
    kind: Any, at: int, names: dict[str, Any], *, as_views: bool = False
) -> tuple[str, int]:
    """Return what makes the value that begins at a place of a row, and where the next one does."""
    parts = _parts(kind)
    if not parts:
        value = f"a.item({at})" if as_views else f"a[i + {at}]"
        return {bool: f"{value} != 0.0", int: f"int({value})"}.get(kind, value), at + 1
    if as_views and kind in _ATOMS:
        matrix = ".reshape(3, 3)" if _axes(kind) == 2 else ""
        return f"a[{at}:{at + len(parts)}]{matrix}", at + len(parts)
    made = []
    for _, part in parts:
        one, at = _making(part, at, names, as_views=as_views)
        made.append(one)
    if isinstance(kind, type) and not get_args(kind):
        names[kind.__name__] = kind
        return f"{kind.__name__}({', '.join(made)})", at
    return f"({', '.join(made)},)", at


def _fills(kind: Any, name: str, at: Iterator[int]) -> Iterable[str]:
    """Return the lines that fill a row with a value whose parts are arrays."""
    parts = _parts(kind)
    if kind in _ATOMS:
        begin = next(at)
        end = begin + len(parts)
        yield f"a[{begin}:{end}] = {name}{'.ravel()' if _axes(kind) == 2 else ''}"
        for _ in parts[1:]:
            next(at)
    for path, part in parts if kind not in _ATOMS else ():
        yield from _fills(part, name + path, at)
    if not parts:
        yield f"a[{next(at)}] = {name}"


def _source(name: str, body: str, names: dict[str, Any]) -> FunctionType:
    """Return a function of a text that is made here; for the cache it is of this file."""
    exec(compile(f"def {name}{body}", __file__, "exec"), names)  # noqa: S102  no text from outside
    made: FunctionType = names[name]
    made.__module__ = __name__
    return made


def to_rows(kind: Any, value: Any) -> Array:
    """Return a value whose parts are arrays, of one sample or of N, as rows (..., width)."""
    parts = _parts(kind)
    if not parts:
        return np.asarray(value, dtype=float)[..., None]
    if kind in _ATOMS:
        array, axes = np.asarray(value, dtype=float), _axes(kind)
        return array.reshape(*array.shape[: array.ndim - axes], len(parts))
    rows = [to_rows(part, v) for (_, part), v in zip(parts, value, strict=True)]
    return _side_by_side(rows)


def _axes(kind: Any) -> int:
    return len(_ATOMS[kind][0])


def _side_by_side(rows: list[Array]) -> Array:
    shape = np.broadcast_shapes(*(row.shape[:-1] for row in rows))
    return np.concatenate([np.broadcast_to(r, (*shape, r.shape[-1])) for r in rows], axis=-1)


def from_rows(kind: Any, rows: Array) -> Any:
    """Return rows (..., width) as a value of a kind whose parts are arrays."""
    parts = _parts(kind)
    if not parts:
        return rows[..., 0] if rows.ndim > 1 else rows[0].item()
    if kind in _ATOMS:
        return rows.reshape(*rows.shape[:-1], *(3,) * _axes(kind))
    values, at = [], 0
    for _, part in parts:
        width = layout(part).width
        values.append(from_rows(part, rows[..., at : at + width]))
        at += width
    return tuple(values) if get_args(kind) else kind(*values)


def sample[T](stack: T, index: int) -> T:
    """Return one of N samples of a value whose parts are arrays."""
    value: Any = stack
    if not isinstance(value, tuple):
        return cast("T", value[index])
    parts = (sample(part, index) for part in value)
    return cast("T", type(value)(*parts) if hasattr(value, "_fields") else tuple(parts))


# --- formulas ------------------------------------------------------------------------------


class Formula(Kernel):
    """A formula: called with values, or with arrays of one sample or of N."""

    def __call__(self, *args: Any) -> Any:
        """Return what the formula makes of values, or of arrays."""
        return self._of_arrays(args) if any(map(_is_array, args)) else self.function(*args)

    @cached_property
    def _kinds(self) -> tuple[dict[str, Any], Any]:
        """The kinds of what it takes, and of what it returns."""
        kinds = get_type_hints(self.function)
        result = kinds.pop("return")
        return kinds, result

    def prepare(self) -> None:
        """Compile what maps it over N samples, now."""
        _ = self._series

    def row(self, *parts: Any) -> Array:
        """Return the value as a row of floats, of parts that are one sample side by side.

        It is compiled, at the first call unless it was prepared.
        """
        return self.rows(np.concatenate(parts, axis=None)[None])[0]

    def rows(self, samples: Array, previous: Array = NONE) -> Array:
        """Return the values (N, ...) of N samples, in each row of which lies what it takes."""
        out = np.empty((len(samples), self._width))
        self._series(samples, previous, out)
        return out

    @cached_property
    def _width(self) -> int:
        return layout(self.result).width

    @property
    def takes(self) -> dict[str, Any]:
        """The kinds of what it takes, by name."""
        return self._kinds[0]

    @property
    def result(self) -> Any:
        """The kind of what it returns."""
        return self._kinds[1]

    def _of_arrays(self, args: tuple[Any, ...]) -> Any:
        kinds, result = self._kinds
        pairs = list(zip(kinds.values(), args, strict=True))
        if not any(_is_stack(kind, arg) for kind, arg in pairs):
            return _arrays(self.function(*(_value(kind, arg) for kind, arg in pairs)))
        rows = dict(zip(kinds, (to_rows(kind, arg) for kind, arg in pairs), strict=True))
        first = rows.pop("previous", NONE)
        samples = np.ascontiguousarray(_side_by_side(list(rows.values())))
        return from_rows(result, self.rows(samples, first))

    @cached_property
    def _series(self) -> Any:
        """The formula over N samples: fills out (N, ...) from what it takes side by side.

        What is called ``previous`` is its value for the sample before.
        """
        kinds, result = self._kinds
        names, at, taken = {"f": self, "put": layout(result).put}, 0, []
        for taker, kind in kinds.items():
            names[f"read_{taker}"] = layout(kind).read
            taken.append("v" if taker == "previous" else f"read_{taker}(a[n], {at})")
            at += layout(kind).width if taker != "previous" else 0
        begin = "    v = read_previous(first, 0)\n" if "previous" in kinds else ""
        loop = f"    for n in range(len(a)):\n        v = f({', '.join(taken)})\n"
        name = f"{self.function.__module__}_{self.function.__name__}".replace(".", "_")
        series = _source(name, f"(a, first, out):\n{begin}{loop}        put(out[n], 0, v)\n", names)
        series.__annotations__ = {"a": Rows, "first": Input, "out": Rows, "return": None}
        return entry(series)


def _is_array(value: Any) -> bool:
    if isinstance(value, tuple):
        return any(map(_is_array, value))
    return isinstance(value, np.ndarray)


def _is_stack(kind: Any, value: Any) -> bool:
    """Whether a value whose parts are arrays is one of N samples."""
    if isinstance(value, tuple):
        return any(_is_stack(k, v) for (_, k), v in zip(_parts(kind), value, strict=True))
    return isinstance(value, np.ndarray) and value.ndim > (_axes(kind) if kind in _ATOMS else 0)


def _value(kind: Any, value: Any) -> Any:
    """Return a value whose parts are arrays of one sample as the formulas have it."""
    if kind in _ATOMS:
        return kind(*value.ravel().tolist())
    if isinstance(value, tuple):
        parts = [_value(k, v) for (_, k), v in zip(_parts(kind), value, strict=True)]
        return kind(*parts) if hasattr(kind, "_fields") else tuple(parts)
    return kind(value)


def _arrays(value: Any) -> Any:
    """Return a value of the formulas as one whose parts are arrays."""
    kind = type(value)
    if kind in _ATOMS:
        return np.array([getattr(value, name) for name in _ATOMS[kind]]).reshape((3,) * _axes(kind))
    if isinstance(value, tuple):
        parts = map(_arrays, value)
        return kind(*parts) if hasattr(kind, "_fields") else tuple(parts)
    return value


def formula(function: Callable[..., Any]) -> Formula:
    """Mark a formula on values; its annotations say of which kinds they are."""
    return Formula(function)


def kernel[R](function: Callable[..., R]) -> Callable[..., R]:
    """Mark what formulas and entries call with rows of floats, of whatever length."""
    return Kernel(function)


def slot(*_args: Any) -> Any:
    """Take the place of a formula that a template is given."""
    raise NotImplementedError


def template(function: Callable[..., Any], name: str, **slots: Any) -> FunctionType:
    """Return a function like another one, of another name, in which these names mean the slots.

    A compiled function that is an argument of another one would not be kept in the cache.
    """
    assert isinstance(function, FunctionType)
    made = FunctionType(function.__code__, {**function.__globals__, **slots}, name)
    made.__qualname__, made.__annotations__ = name, function.__annotations__
    made.__module__, made.__doc__ = function.__module__, function.__doc__
    return made


def entry[R](function: Callable[..., R]) -> Callable[..., R]:
    """Compile what Python calls for the types of its annotations, now; see :data:`Row`."""
    hints = get_type_hints(function, include_extras=True)
    result = hints.pop("return")
    if IS_COMPILED:
        return _njit(function, _type(result)(*map(_type, hints.values())))

    @wraps(function)
    def plain(*args: Any) -> Any:
        with np.errstate(all="ignore"):  # numbers of rows become infinite or NaN without a word
            value = function(*args)
        return None if value is None else result(value)

    return plain


# --- numba ---------------------------------------------------------------------------------

type Rule = tuple[Callable[..., Any], tuple[type, ...], Callable[..., Any]]
"""An operator, the kinds that it is between, and what it does."""


def register(
    atoms: tuple[type, ...],
    rules: Iterable[Rule],
    properties: Iterable[tuple[type, str, Callable[..., Any]]],
) -> None:
    """Make classes of floats kinds of values, with the operators between them.

    Their ``__slots__`` are the floats; a name has one letter for each axis of the array.
    """
    _ATOMS.update({atom: tuple(atom.__slots__) for atom in atoms})  # type: ignore[attr-defined]
    if not IS_COMPILED:
        return
    kinds: dict[type, Any] = {atom: _struct(atom, _ATOMS[atom]) for atom in atoms}
    tables: dict[Any, dict[Any, Any]] = {}
    for operation, between, rule in rules:
        tables.setdefault(operation, {})[tuple(kinds.get(k, numba.float64) for k in between)] = rule
    for operation, table in tables.items():
        numba.extending.overload(operation, strict=False)(_chosen_from(table))
    for atom, name, rule in properties:
        _add_property(type(kinds[atom]), name, rule)


def _add_property(struct: Any, name: str, rule: Callable[..., Any]) -> None:
    @numba.extending.overload_attribute(struct, name, strict=False)
    def chosen(_value: Any) -> Callable[..., Any]:
        return rule


def _chosen_from(table: dict[Any, Any]) -> Callable[..., Any]:
    """Return what chooses the rule of an operator by the types that it is between."""

    def is_number(kind: Any) -> bool:
        return isinstance(kind, numba.types.Number)

    def unary(a: Any) -> Any:
        return table.get((a,))

    def binary(a: Any, b: Any) -> Any:
        return table.get(tuple(numba.float64 if is_number(k) else k for k in (a, b)))

    return unary if len(next(iter(table))) == 1 else binary


def _struct(atom: type, fields: tuple[str, ...]) -> Any:
    """Return numba's type for a class of floats, of which it now knows all."""
    float64 = numba.float64

    # by name, so that what is compiled in another process finds it
    Struct = type(f"Type{atom.__name__}", (numba.types.Type,), {"__module__": __name__})
    globals()[Struct.__name__] = Struct

    @numba.extending.register_model(Struct)
    class Model(numba.extending.models.StructModel):  # type: ignore[misc]
        def __init__(self, manager: Any, kind: Any) -> None:
            super().__init__(manager, kind, [(name, float64) for name in fields])

    for field in fields:
        numba.extending.make_attribute_wrapper(Struct, field, field)
    struct = Struct(atom.__name__)

    @numba.extending.type_callable(atom)
    def typed(_context: Any) -> Callable[..., Any]:
        def kind(*_args: Any) -> Any:
            return struct

        kind.__signature__ = inspect.signature(atom)  # type: ignore[attr-defined]
        return kind

    @numba.extending.lower_builtin(atom, *(float64 for _ in fields))
    def made(context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        value = numba.core.cgutils.create_struct_proxy(struct)(context, builder)
        for name, arg in zip(fields, args, strict=True):
            setattr(value, name, arg)
        return value._getvalue()

    return struct


def _type(kind: Any) -> Any:
    """Return numba's type for the annotation of an entry."""
    if kind in (float, int, bool):
        return {float: numba.float64, int: numba.int64, bool: numba.boolean}[kind]
    if kind is type(None):
        return numba.void
    if kind is bytes:
        return numba.types.Bytes(numba.uint8, 1, "C", readonly=True)
    _, dtype, axes, order, is_read_only = get_args(kind)
    return numba.types.Array(getattr(numba, dtype), axes, order, readonly=is_read_only)


def _njit(function: Callable[..., Any], *signatures: Any) -> Any:
    """Return a function compiled for these types now, or for any as they come."""
    options = {"cache": _is_ours(function), "error_model": "numpy", "no_cfunc_wrapper": True}
    options["no_cpython_wrapper"] = not signatures  # Python calls entries only
    with numba.core.compiler_lock.global_compiler_lock:  # the folder is that of all threads
        before, numba.config.CACHE_DIR = numba.config.CACHE_DIR, cache_folder()
        try:
            compiled = numba.njit(list(signatures) or None, **options)(function)
        finally:
            numba.config.CACHE_DIR = before
    if signatures and _is_ours(function) and compiled.stats.cache_misses:
        _say_once()
    return compiled


@contextmanager
def nothing_compiled() -> Iterator[None]:
    """Load what is compiled, but compile nothing: while an arm moves its commands cannot wait.

    Raises:
        NotCompiledError: where something would have to be compiled.
    """
    if not IS_COMPILED:
        yield
        return
    with numba.core.event.install_listener("numba:compile", _Refusal()):
        yield


@cache
def _is_ours(function: Callable[..., Any]) -> bool:
    """Whether a function, with all that it calls, is in the files that the cache is named by.

    What is not, of a representation elsewhere, say, is compiled again by each process.
    """
    code = function.__code__
    named = (function.__globals__.get(name) for name in code.co_names)
    return any(Path(code.co_filename).is_relative_to(room) for room in _ROOMS) and all(
        _is_ours(called.function) for called in named if isinstance(called, Kernel)
    )


@cache
def _say_once() -> None:
    """Say, once, that formulas are compiled."""
    print(
        "eulerparams_control: compiling the formulas, once for this version and this machine: half "
        "a minute for one controller on an idle processor, minutes on a busy one or for all "
        f"(kept in {cache_folder()})",
        file=sys.stderr,
        flush=True,
    )


def fingerprint() -> str:
    """Return what changes with the contents of the files that have formulas, or with numba."""
    found = (file for room in _ROOMS for file in (room, *room.rglob("*.py")))
    files = sorted(file for file in found if file.is_file())
    compiler = numba.__version__.encode() if IS_COMPILED else b""
    contents = b"".join(file.read_bytes() for file in files)
    return hashlib.sha256(compiler + contents).hexdigest()[:12]


@cache
def cache_folder() -> str:
    """Return the folder of what is compiled, for this state of the files that have formulas.

    That is below NUMBA_CACHE_DIR, or $XDG_CACHE_HOME, or ~/.cache; where none can be written, a
    folder that lasts as long as this process.  numba alone would not see a change in a file from
    which a formula is called.
    """
    root, state = Path("~/.cache"), fingerprint()
    try:
        home = os.environ.get("NUMBA_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME")
        root = Path(home or Path.home() / ".cache", "eulerparams_control")
        folder = root / state
        folder.mkdir(parents=True, exist_ok=True)
        os.utime(folder)
        tempfile.TemporaryFile(dir=folder).close()
    except (OSError, RuntimeError) as error:  # the latter: there is no home
        warnings.warn(
            f"compiled formulas cannot be kept in {root} ({error}), so each start compiles them "
            "again, for half a minute or more; set NUMBA_CACHE_DIR to a folder that can be written",
            stacklevel=2,
        )
        own = tempfile.mkdtemp(prefix="eulerparams_control_")
        atexit.register(_remove, own, os.getpid())
        return own
    for old in root.glob("?" * len(state)):
        with suppress(OSError):  # another process may do the same
            if time.time() - old.stat().st_mtime > _KEPT:
                shutil.rmtree(old, ignore_errors=True)
    return str(folder)


def _remove(folder: str, owner: int) -> None:
    """Remove a folder at the end of the process that made it, not of one that was forked."""
    if os.getpid() == owner:
        shutil.rmtree(folder, ignore_errors=True)


if IS_COMPILED:

    class _Refusal(numba.core.event.Listener):  # type: ignore[misc]
        """Refuses to compile: numba tells it after it has looked into the cache."""

        def on_start(self, event: Any) -> None:
            raise NotCompiledError

        def on_end(self, event: Any) -> None:
            """Do nothing: it never began."""

    @numba.extending.typeof_impl.register(Kernel)
    def _typeof(kernel: Kernel, context: Any) -> Any:
        return numba.extending.typeof_impl(kernel.compiled, context)
