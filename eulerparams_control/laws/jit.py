"""Compilation of the primitives: numba, with the types of what Python calls them with.

    @jit(f8(vector, vector))
    def dot(v, w): ...

A primitive is compiled when its module is imported, or loaded from the cache: nothing compiles
while an arm moves.  ``NUMBA_DISABLE_JIT=1`` in the environment runs the same source as it is.
"""

import hashlib
import os
import shutil
import sys
import time
import warnings
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, cast

import numba
import numpy as np
from numpy.typing import NDArray

type Array = NDArray[np.float64]

types = numba.types
f8, i8, b1, void = types.float64, types.int64, types.boolean, types.void
vector = types.Array(f8, 1, "A", readonly=True)
matrix = types.Array(f8, 2, "A", readonly=True)
"""Arrays that are read, however they lie in memory."""
new_vector, new_matrix = f8[::1], f8[:, ::1]
"""Arrays that are returned, or filled."""

# Folders whose files have primitives, and how long [s] what is compiled for a state of these files
# stays unused.
_ROOMS = tuple(Path(__file__).parents[1] / room for room in ("laws", "motion", "control"))
_KEPT = 14 * 86400.0


def jit[**P, R](signature: Any) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Compile a function for a numba signature; divisions by zero give infinity or NaN."""

    def compiled(function: Callable[P, R]) -> Callable[P, R]:
        folder, before = cache_folder(), numba.config.CACHE_DIR
        options = {"cache": folder is not None, "error_model": "numpy", "no_cfunc_wrapper": True}
        numba.config.CACHE_DIR = folder or before
        try:
            made = numba.njit(signature, **options)(function)
        finally:
            numba.config.CACHE_DIR = before
        if not numba.config.DISABLE_JIT and not made.stats.cache_hits:
            _announce()
        return cast("Callable[P, R]", made)

    return compiled


@cache
def _announce() -> None:
    print(
        "eulerparams_control: compiling the primitives of the laws, once for this version and this "
        f"machine: 10 s on an idle processor (kept in {cache_folder()})",
        file=sys.stderr,
        flush=True,
    )


@cache
def cache_folder() -> str | None:
    """Return the cache folder for this state of the files; None where none can be written.

    By itself numba would not see a change in a file from which a primitive is called.
    """
    files = sorted(file for room in _ROOMS for file in room.rglob("*.py"))
    primitives = b"".join(text for text in map(Path.read_bytes, files) if b"@jit(" in text)
    state = hashlib.sha256(numba.__version__.encode() + primitives).hexdigest()[:12]
    home = os.environ.get("NUMBA_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME")
    root = Path(home or "~/.cache", "eulerparams_control")
    try:
        root = root.expanduser()
        folder = root / state
        folder.mkdir(parents=True, exist_ok=True)
        os.utime(folder)
    except (OSError, RuntimeError) as error:  # the latter: there is no home
        warnings.warn(
            f"compiled primitives cannot be kept in {root} ({error}), so each start compiles them "
            "again; set NUMBA_CACHE_DIR to a folder that can be written",
            stacklevel=2,
        )
        return None
    for old in root.glob("?" * len(state)):
        with suppress(OSError):  # another process may do the same
            if time.time() - old.stat().st_mtime > _KEPT:
                shutil.rmtree(old, ignore_errors=True)
    return str(folder)
