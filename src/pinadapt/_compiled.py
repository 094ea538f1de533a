"""Compiled kernels: the small-matrix algebra of a control step, in loops.

A numpy call on a 3 x 7 matrix spends its microsecond on the call, and a control step would need
over a hundred of them. A kernel is a plain function of float arrays that states one formula; numba
compiles it for one signature, whose arrays may have any memory layout unless it says otherwise.
Arithmetic stays IEEE: nothing is reordered, a division by zero gives inf, and NaN comes through.
The machine code is kept on disk beside the source, or in the user's cache where that cannot be
written, or nowhere; a damaged file is replaced. Arrays are borrowed, see ``_borrowed``, or where
they cannot be held as numba does by default. Kernels fill arrays that their caller has made,
because numba is slow at returning arrays, and do not call each other, because the copy on disk
would not see the other change. They do not check the sizes of their arrays: callers pass what numpy
or Pinocchio made or checked.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import cache
from typing import Any, TypeVar

Function = TypeVar("Function", bound=Callable[..., Any])

kernels: dict[str, Any] = {}  # by module and name, once compiled, with their dispatcher
_waiting: list[tuple[Callable[..., Any], str, int]] = []


def compiled(signature: str, fills: int = 1) -> Callable[[Function], Function]:
    """Make a function of a module a kernel with a signature as in numba: "void(f8[:,:], f8[:])".

    The last ``fills`` arguments are the arrays that it fills; the others it only reads, so they may
    be read-only. Its name stands for plain Python until ``compile_all``, and from then on for the
    machine code itself, with nothing in between; so call a kernel by its name in its own module.
    """

    def register(function: Function) -> Function:
        """Put the function on the list of ``compile_all``."""
        _waiting.append((function, signature, fills))
        return function

    return register


def compile_all() -> None:
    """Compile all kernels or load them from disk; done when a controller is made, not in a step."""
    while _waiting:
        function, signature, fills = _waiting[-1]
        dispatcher = _machine_code(function, signature, fills)
        kernels[f"{function.__module__}.{function.__name__}"] = dispatcher
        (compiled_for,) = dispatcher.overloads.values()
        function.__globals__[function.__name__] = compiled_for.entry_point
        _waiting.pop()


def _machine_code(function: Callable[..., Any], signature: str, fills: int) -> Any:
    """Return numba's dispatcher of a kernel, of arrays that it borrows where that can be."""
    from numba import types  # here, because most imports need no compiler

    borrowed = _borrowed_array()
    if borrowed is not None:
        with suppress(Exception):  # of a numba whose inside is another one
            return _compile(function, signature, fills, borrowed)
    return _compile(function, signature, fills, types.Array)


@cache
def _borrowed_array() -> Any:
    """Return the type of borrowed arrays; None where numpy or numba is not as it assumes."""
    try:
        from . import _borrowed
    except (ImportError, AttributeError):
        return None
    return _borrowed.Borrowed if _borrowed.layout_holds() else None


def _compile(function: Callable[..., Any], signature: str, fills: int, array: Any) -> Any:
    from numba import njit, types
    from numba.core.sigutils import normalize_signature

    arguments, result = normalize_signature(signature)
    read = len(arguments) - fills
    kinds = [
        array(kind.dtype, kind.ndim, kind.layout, readonly=i < read)
        if isinstance(kind, types.Array)
        else kind
        for i, kind in enumerate(arguments)
    ]
    typed = result(*kinds)
    try:
        return njit(typed, cache=True, error_model="numpy")(function)
    except Exception:  # a cache that cannot be written, or a damaged one: any error of unpickling
        _empty_cache(function)
        return njit(typed, error_model="numpy")(function)


def _empty_cache(function: Callable[..., Any]) -> None:
    """Forget what is on disk of a kernel, if anything, so that the next process writes it anew."""
    from numba import njit

    with suppress(RuntimeError, OSError):
        njit(cache=True)(function)._cache.flush()  # type: ignore[attr-defined]
