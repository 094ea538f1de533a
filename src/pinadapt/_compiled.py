"""Compiled kernels: the small-matrix algebra of a control step, in loops.

A numpy call on a 3 x 7 matrix spends its microsecond on the call, and a control step would need
over a hundred of them. A kernel is a plain function of float arrays that computes one formula;
numba compiles it for one signature, whose arrays may have any memory layout unless it says
otherwise. Arithmetic stays IEEE: nothing is reordered, a division by zero gives inf, and NaN
propagates. The machine code is cached beside the source, or in the user's cache where that cannot
be written, or not at all; a damaged cache file is replaced.

Kernels fill arrays that their caller has made, because numba is slow at returning arrays, and do
not call each other, because the cache on disk would not notice a change of the other. A kernel
checks at its beginning that the sizes of its arrays fit, which takes a nanosecond, and raises an
``ArrayError`` else, as it would read outside of an array that is too short. It does not check that
they are arrays of floats with the axes that it was compiled for: what users give becomes such
arrays at the doors of the public methods, see ``_checks.Doors``.
"""

from __future__ import annotations

import ctypes
import gc
import os
import random
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

Function = TypeVar("Function", bound=Callable[..., Any])

kernels: dict[str, Any] = {}  # numba's dispatchers, by module and name, once compiled
_waiting: list[tuple[Callable[..., Any], str, int, bool]] = []


def compiled(
    signature: str, fills: int = 1, allocates: bool = False
) -> Callable[[Function], Function]:
    """Make a function of a module a kernel with a signature as in numba: "void(f8[:,:], f8[:])".

    The last ``fills`` arguments are the arrays that it fills; it only reads the others, so they may
    be read-only. A kernel that makes arrays of its own says so by ``allocates``; the others are
    compiled without numba's counting of references, which takes as long as a small kernel's
    arithmetic. Until ``compile_all`` its name means the Python function, and from then on the
    entry point of the machine code, which has no dispatch by argument types; so call a kernel by
    its name in its own module.
    """

    def register(function: Function) -> Function:
        """Put the function on the list of ``compile_all``."""
        _waiting.append((function, signature, fills, allocates))
        return function

    return register


def compile_all() -> None:
    """Compile all kernels or load them from disk; done when a controller is made, not in a step.

    Each process has an order of its own, so that processes which start together without machine
    code on disk find in it what the others compiled, instead of all compiling everything. The
    garbage collector rests meanwhile: numba keeps nearly all of the many objects that it makes.
    With ``NUMBA_DISABLE_JIT=1`` the kernels stay Python functions, for a debugger; they take some
    hundred times as long.
    """
    if not _waiting:
        return
    from numba import config  # here, because most imports need no compiler

    if vars(config)["DISABLE_JIT"]:
        _waiting.clear()
        return
    random.Random(os.getpid()).shuffle(_waiting)
    with _without_garbage_collector():
        while _waiting:
            function, signature, fills, allocates = _waiting[-1]
            dispatcher = _machine_code(function, signature, fills, allocates)
            kernels[f"{function.__module__}.{function.__name__}"] = dispatcher
            (compiled_for,) = dispatcher.overloads.values()
            function.__globals__[function.__name__] = compiled_for.entry_point
            _waiting.pop()


@contextmanager
def _without_garbage_collector() -> Iterator[None]:
    """Keep the garbage collector off, if it was on."""
    if not gc.isenabled():
        yield
        return
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


def _machine_code(function: Callable[..., Any], signature: str, fills: int, allocates: bool) -> Any:
    """Return numba's dispatcher of a kernel, compiled for its one signature."""
    from numba import njit, types  # here, because most imports need no compiler
    from numba.core.sigutils import normalize_signature

    arguments, result = normalize_signature(signature)
    read = len(arguments) - fills
    typed = result(
        *(
            kind.copy(readonly=True) if isinstance(kind, types.Array) and i < read else kind
            for i, kind in enumerate(arguments)
        )
    )
    # no counting of references: an option of numba's that its documentation does not have
    counting: dict[str, Any] = {} if allocates else {"_nrt": False}
    try:
        return njit(typed, cache=True, error_model="numpy", **counting)(function)
    except Exception:  # a cache that cannot be written, or a damaged one: errors of unpickling
        _empty_cache(function)
        return njit(typed, error_model="numpy", **counting)(function)


def _empty_cache(function: Callable[..., Any]) -> None:
    """Forget what is on disk of a kernel, if anything, so that the next process writes it anew."""
    from numba import njit

    with suppress(RuntimeError, OSError):
        njit(cache=True)(function)._cache.flush()  # type: ignore[attr-defined]


_BLAS = (
    "scipy_openblas_{}_num_threads64_",
    "scipy_openblas_{}_num_threads",
    "openblas_{}_num_threads64_",
    "openblas_{}_num_threads",
)


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Have the linear algebra of numpy and scipy use one thread meanwhile, where it is OpenBLAS.

    Matrices of a hundred parameters gain nothing from several threads, and lose most of the time
    where there are more threads than processors, as in a container; in a loop on a clock, they wait
    for threads without its priority. Nothing else is changed, and nothing at all with another
    library.
    """
    before = [(int(get()), put) for get, put in _blas_threads()]
    for _, put in before:
        put(1)
    try:
        yield
    finally:
        for count, put in before:
            put(count)


def _blas_threads() -> list[tuple[Any, Any]]:
    """Return functions that get and set the number of threads of each OpenBLAS of the wheels."""
    folder, found = Path(np.__file__).parent, []
    for file in (
        *folder.parent.glob("numpy.libs/*openblas*"),
        *folder.parent.glob("scipy.libs/*openblas*"),
        *folder.glob(".dylibs/*openblas*"),
        *folder.parent.glob("scipy/.dylibs/*openblas*"),
    ):
        with suppress(OSError):
            library = ctypes.CDLL(str(file))
            named = (name for name in _BLAS if hasattr(library, name.format("set")))
            for name in [*named][:1]:
                get, put = (getattr(library, name.format(verb)) for verb in ("get", "set"))
                found.append((get, put))
    return found
