"""Compiled kernels: the small-matrix algebra of a control step, in loops.

A numpy call on a 3 x 7 matrix spends its microsecond on the call, and a control step would need
over a hundred of them. A kernel is a plain function of float arrays that computes one formula;
numba compiles it for the one signature that its annotations state, whose arrays may have any memory
layout unless they are packed. Arithmetic stays IEEE: nothing is reordered, a division by zero gives
inf, and NaN propagates. A kernel is compiled when it is first called, and its machine code is
cached beside the source, or in the user's cache where that cannot be written, or not at all; a
damaged cache file is replaced. With ``NUMBA_DISABLE_JIT=1`` the kernels stay Python functions, for
a debugger.

Kernels fill arrays that their caller has made, because numba is slow at returning arrays, and do
not call each other, because the cache on disk would not notice a change of the other. An index
outside of an array is an ``IndexError``, which takes a nanosecond to check. What a kernel is given
has to be arrays of floats with the axes that it was compiled for: what users give becomes such
arrays where it enters.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import suppress
from functools import cache, wraps
from typing import Annotated, Any, TypeVar, cast, get_args, get_type_hints

import numpy as np

Function = TypeVar("Function", bound=Callable[..., Any])

# what kernels take, as numba writes it: arrays of floats or indices, any memory layout, or packed
Vector = Annotated[np.ndarray, "f8[:]"]
Matrix = Annotated[np.ndarray, "f8[:,:]"]
Matrices = Annotated[np.ndarray, "f8[:,:,:]"]
Indices = Annotated[np.ndarray, "i8[:]"]
IndexTable = Annotated[np.ndarray, "i8[:,:]"]
PackedVector = Annotated[np.ndarray, "f8[::1]"]
PackedMatrix = Annotated[np.ndarray, "f8[:,::1]"]
_SCALARS: dict[Any, str] = {float: "f8", int: "i8", bool: "b1"}

kernels: dict[str, Any] = {}  # numba's dispatchers, by module and name, once compiled
_entry_points: list[Callable[[], Callable[..., Any]]] = []  # of all kernels that are defined
_NOTE = "pinadapt: compiling its kernels, once on this machine ..."


def compiled(fills: int = 1, allocates: bool = False) -> Callable[[Function], Function]:
    """Make a function of a module a kernel.

    The last ``fills`` arguments are the arrays that it fills; it only reads the others, so they may
    be read-only. A kernel that makes arrays of its own says so by ``allocates``; the others are
    compiled without numba's counting of references, which takes as long as a small kernel's
    arithmetic. From the first call on, its name means the entry point of the machine code, which
    has no dispatch by argument types; so call a kernel by its name in its own module.
    """

    def register(function: Function) -> Function:
        """Return a function that compiles the kernel and takes its place."""

        @cache
        def entry_point() -> Callable[..., Any]:
            """Return the machine code, compiled or loaded from disk."""
            return _entry_point(function, fills, allocates)

        _entry_points.append(entry_point)

        @wraps(function)
        def first_call(*arguments: Any) -> Any:
            """Have the machine code take this name, and call it."""
            call = function.__globals__[function.__name__] = entry_point()
            return call(*arguments)

        return cast(Function, first_call)

    return register


def compile_all() -> None:
    """Compile all kernels of the modules that are imported, or load them from disk."""
    for entry_point in _entry_points:
        entry_point()


def _entry_point(function: Callable[..., Any], fills: int, allocates: bool) -> Callable[..., Any]:
    """Return the machine code of a kernel, compiled for its one signature."""
    from numba import config, njit, types  # here, because most imports need no compiler
    from numba.core.sigutils import normalize_signature

    if vars(config)["DISABLE_JIT"]:
        return function
    *hints, result = get_type_hints(function, include_extras=True).values()
    names = (_SCALARS.get(hint) or hint.__metadata__[0] for hint in hints)
    several = ", ".join(_SCALARS[part] for part in get_args(result))
    returned = f"Tuple(({several}))" if several else _SCALARS.get(result, "void")
    arguments, made = normalize_signature(f"{returned}({', '.join(names)})")
    first = len(arguments) - fills
    read = [
        kind.copy(readonly=True) if isinstance(kind, types.Array) else kind
        for kind in arguments[:first]
    ]
    typed = made(*read, *arguments[first:])
    # no counting of references: an option of numba's that its documentation does not have
    counting: dict[str, Any] = {} if allocates else {"_nrt": False}
    options = {"error_model": "numpy", "boundscheck": True, **counting}
    try:
        dispatcher = njit(typed, cache=True, **options)(function)
    except Exception:  # a cache that cannot be written, or a damaged one: errors of unpickling
        _empty_cache(function)
        dispatcher = njit(typed, **options)(function)
    found = [kernel.stats.cache_hits for kernel in kernels.values()]  # on disk
    if not dispatcher.stats.cache_hits and sys.stderr.isatty() and all(found):
        print(_NOTE, file=sys.stderr)
    kernels[f"{function.__module__}.{function.__name__}"] = dispatcher
    (only,) = dispatcher.overloads.values()
    return cast(Callable[..., Any], only.entry_point)


def _empty_cache(function: Callable[..., Any]) -> None:
    """Forget what is on disk of a kernel, if anything, so that the next process writes it anew."""
    from numba import njit

    with suppress(RuntimeError, OSError):
        njit(cache=True)(function)._cache.flush()  # type: ignore[attr-defined]
