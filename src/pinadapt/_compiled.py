"""Compiled kernels: the small-matrix algebra of a control step, in loops.

A numpy call on a 3 x 7 matrix spends its microsecond on the call, and a control step would need
over a hundred of them. A kernel is a plain function of float arrays that computes one formula;
numba compiles it for one signature, whose arrays may have any memory layout unless it says
otherwise. Arithmetic stays IEEE: nothing is reordered, a division by zero gives inf, and NaN
propagates. The machine code is cached beside the source, or in the user's cache where that cannot
be written, or not at all; a damaged cache file is replaced.

Kernels fill arrays that their caller has made, because numba is slow at returning arrays, and do
not call each other, because the cache on disk would not notice a change of the other.

A kernel raises an ``ArrayError`` rather than read or write outside of an array. Its machine code
checks that each argument is an array of the kind, the number of axes and the layout of the
signature, writeable if it is filled (numba's own would believe it, and takes 4 ns longer an array);
its first lines check that the sizes fit.
"""

from __future__ import annotations

import ctypes
import gc
import os
import random
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from .exceptions import ArrayError

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
            _array_type(kind.dtype, kind.ndim, kind.layout, i < read)
            if isinstance(kind, types.Array)
            else kind
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


# Where numpy keeps what an array is [bytes from the beginning of the object], see PyArrayObject and
# PyArray_Descr in its C API; the head of an object ends with its type.
_HEAD = object.__basicsize__
_TYPE, _DATA, _AXES, _LENGTHS, _STRIDES = _HEAD - 8, _HEAD, _HEAD + 8, _HEAD + 16, _HEAD + 24
_KIND, _FLAGS = _HEAD + 40, _HEAD + 48
_ORDER, _NUMBER = _HEAD + 10, _HEAD + 12  # of a kind
_CONTIGUOUS, _WRITEABLE = 0x1, 0x400
_SWAPPED = ord(">" if sys.byteorder == "little" else "<")
_NDARRAY, _ERROR = "pinadapt_ndarray", "pinadapt_array_error"  # symbols of machine code


def _array_type(dtype: Any, axes: int, layout: str, readonly: bool) -> Any:
    """Return numba's type of an array that is checked where machine code receives it."""
    return _checked_array()(dtype, axes, layout, readonly=readonly)


@cache
def _checked_array() -> Any:
    """Return the class of such types; that of numba where arrays are not laid out as expected."""
    import llvmlite.binding  # here, because most imports need no compiler
    from numba.core import types
    from numba.core.datamodel import models, register_default
    from numba.core.extending import unbox

    if not _laid_out_as_expected(np.ones((2, 3))[:, ::2]):
        return types.Array

    class CheckedArray(types.Array):
        """An array that is checked where machine code receives it."""

        def __reduce__(self) -> tuple[Any, ...]:
            return _array_type, (self.dtype, self.ndim, self.layout, not self.mutable)

    llvmlite.binding.add_symbol(_NDARRAY, id(np.ndarray))
    llvmlite.binding.add_symbol(_ERROR, id(ArrayError))
    register_default(CheckedArray)(models.ArrayModel)
    unbox(CheckedArray)(_unboxed)
    return CheckedArray


def _laid_out_as_expected(array: np.ndarray) -> bool:
    """Return whether an array (2, 2) of floats is in memory as ``_unboxed`` reads it."""

    def there(kind: Any, place: int, offset: int) -> Any:
        return kind.from_address(place + offset).value

    at, dtype, word = id(array), id(array.dtype), ctypes.c_ssize_t
    return (
        ctypes.sizeof(ctypes.c_void_p) == ctypes.sizeof(word) == 8
        and np.ndarray.__basicsize__ >= _FLAGS + 4
        and there(word, at, _TYPE) == id(np.ndarray)
        and there(word, at, _DATA) == array.ctypes.data
        and there(ctypes.c_int, at, _AXES) == array.ndim
        and there(word, at, _KIND) == dtype
        and there(ctypes.c_int, at, _FLAGS) == array.flags.num
        and all(
            tuple((word * 2).from_address(there(word, at, place))) == expected
            for place, expected in ((_LENGTHS, array.shape), (_STRIDES, array.strides))
        )
        and there(ctypes.c_int, dtype, _NUMBER) == array.dtype.num
        and there(ctypes.c_char, dtype, _ORDER) == b"="
    )


def _unboxed(kind: Any, value: Any, c: Any) -> Any:
    """Write machine code that takes an array from a Python object, or raises ``ArrayError``.

    Args:
        kind: numba's type of the array.
        value: the object, in LLVM.
        c: numba's context of the conversion.
    """
    from llvmlite import ir  # here, because most imports need no compiler
    from numba.core import cgutils
    from numba.core.pythonapi import NativeValue
    from numba.np.numpy_support import as_dtype

    code, word, number, byte = c.builder, ir.IntType(64), ir.IntType(32), ir.IntType(8)
    address, array = byte.as_pointer(), c.context.make_array(kind)(c.context, c.builder)

    def at(place: Any, offset: int, what: Any) -> Any:
        """Return what is at an offset [bytes] from a place."""
        there = code.gep(code.bitcast(place, address), [word(offset)])
        return code.load(code.bitcast(there, what.as_pointer()))

    def symbol(name: str) -> Any:
        """Return the address that has a name."""
        known = code.module.globals.get(name)
        return known or ir.GlobalVariable(code.module, byte, name)

    of, ndarray = at(value, _TYPE, address), symbol(_NDARRAY)
    exactly = code.icmp_unsigned("==", of, ndarray)
    is_array, fits = (cgutils.alloca_once_value(code, bit) for bit in (exactly, cgutils.false_bit))
    with code.if_then(code.not_(exactly), likely=False):
        inherits = cgutils.get_or_insert_function(
            code.module, ir.FunctionType(number, [address, address]), "PyType_IsSubtype"
        )
        inherited = code.icmp_signed("!=", code.call(inherits, [of, ndarray]), number(0))
        code.store(inherited, is_array)
    with code.if_then(code.load(is_array), likely=True):
        dtype, order = as_dtype(kind.dtype), at(at(value, _KIND, address), _ORDER, byte)
        flags = (_CONTIGUOUS if kind.layout == "C" else 0) | (_WRITEABLE if kind.mutable else 0)
        right = code.icmp_signed("==", at(value, _AXES, number), number(kind.ndim))
        for found, wanted in (
            (at(at(value, _KIND, address), _NUMBER, number), dtype.num),
            (code.and_(at(value, _FLAGS, number), number(flags)), flags),
        ):
            right = code.and_(right, code.icmp_signed("==", found, number(wanted)))
        right = code.and_(right, code.icmp_signed("!=", order, byte(_SWAPPED)))
        with code.if_then(right, likely=True):
            lengths, strides = (
                [at(at(value, place, address), 8 * k, word) for k in range(kind.ndim)]
                for place in (_LENGTHS, _STRIDES)
            )
            size = word(1)
            for length in lengths:
                size = code.mul(size, length)
            array.meminfo = cgutils.get_null_value(array.meminfo.type)
            array.parent, array.nitems, array.itemsize = value, size, word(dtype.itemsize)
            array.data = code.bitcast(at(value, _DATA, address), array.data.type)
            array.shape = cgutils.pack_array(code, lengths, word)
            array.strides = cgutils.pack_array(code, strides, word)
            code.store(cgutils.true_bit, fits)
    refused = code.not_(code.load(fits))
    with code.if_then(refused, likely=False):
        error = symbol(_ERROR)
        instance = c.pyapi.call_function_objargs(error, ())
        c.pyapi.err_set_object(error, instance)
        c.pyapi.decref(instance)
    return NativeValue(array._getvalue(), is_error=refused)


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
