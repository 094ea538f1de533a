"""Arrays that a kernel borrows: address, shape and strides, for the time of a call.

numba takes hold of every array by a reference of its own, allocated and freed in each call: 70 ns
an array, more than most kernels compute. The caller's arguments, temporaries among them, stay alive
until the kernel returns, and kernels keep Python's lock; so all that a kernel needs stands in the
array object, whose layout is numpy's binary interface. ``layout_holds`` compares that layout with
what numpy says of sample arrays; where it does not hold, kernels take numba's own arrays.
"""

from __future__ import annotations

import ctypes
import sys
import sysconfig
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import NativeValue, models, register_model, unbox
from numba.np.arrayobj import populate_array
from numba.np.numpy_support import as_dtype

_WORD_SIZE = 8
_WORD, _INT, _BYTE = ir.IntType(64), ir.IntType(32), ir.IntType(8)
_PLACE = _BYTE.as_pointer()
_FOREIGN = ord(">" if sys.byteorder == "little" else "<")


class _Object(ctypes.Structure):
    """PyObject_HEAD, of which the type is the last word."""

    _fields_ = (
        ("counts", ctypes.c_byte * (object.__basicsize__ - _WORD_SIZE)),
        ("type", ctypes.c_void_p),
    )


class _Dtype(ctypes.Structure):
    """The beginning of PyArray_Descr."""

    _fields_ = (
        *_Object._fields_,
        ("scalar", ctypes.c_void_p),
        ("kind", ctypes.c_byte),
        ("letter", ctypes.c_byte),
        ("order", ctypes.c_byte),
        ("flags", ctypes.c_byte),
        ("number", ctypes.c_int),
    )


class _Array(ctypes.Structure):
    """The beginning of PyArrayObject."""

    _fields_ = (
        *_Object._fields_,
        ("data", ctypes.c_void_p),
        ("dimension", ctypes.c_int),
        ("shape", ctypes.c_void_p),
        ("strides", ctypes.c_void_p),
        ("base", ctypes.c_void_p),
        ("dtype", ctypes.c_void_p),
    )


def layout_holds() -> bool:
    """Tell whether array objects are laid out as the generated code assumes."""
    if ctypes.sizeof(ctypes.c_void_p) != _WORD_SIZE or sysconfig.get_config_var("Py_GIL_DISABLED"):
        return False
    plain = np.arange(24.0).reshape(4, 6)
    samples = plain, plain.T, plain[::-2, 1::3], plain.astype(np.int64), plain[0], plain[:0]
    return all(map(_is_read_rightly, (*samples, plain.astype(">f8"), plain.astype("<f8"))))


def _is_read_rightly(array: np.ndarray) -> bool:
    """Tell whether an array's object, read by the assumed layout, says what numpy says."""
    read = _Array.from_address(id(array))
    if read.type != id(np.ndarray) or read.dimension != array.ndim or read.dtype != id(array.dtype):
        return False
    row, dtype = ctypes.c_int64 * array.ndim, _Dtype.from_address(read.dtype)
    return (
        read.data == array.ctypes.data
        and tuple(row.from_address(read.shape)) == array.shape
        and tuple(row.from_address(read.strides)) == array.strides
        and dtype.number == array.dtype.num
        and chr(dtype.order) == array.dtype.byteorder
    )


def _digest() -> str:
    """Return what tells this file from other versions of it."""
    try:
        return sha256(Path(__file__).read_bytes()).hexdigest()
    except OSError:  # without source, so without a cache on disk
        return ""


_SOURCE = _digest()


class Borrowed(types.Array):
    """An array of numba's that is not held by a reference.

    It remembers which version of this file it is of: the code made here is part of each kernel on
    disk, and another version must not find it.
    """

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        """Take what an array takes."""
        self._source = _SOURCE
        super().__init__(*args, **kwargs)

    @property
    def key(self) -> tuple[Any, ...]:
        """What two equal types share."""
        return (*super().key, self._source)


register_model(Borrowed)(models.ArrayModel)


@unbox(Borrowed)
def _unbox(kind: Borrowed, given: Any, c: Any) -> NativeValue:
    """Generate the code that makes of a Python object the array that a kernel computes with.

    It raises TypeError for anything but an array of this dimension and dtype, in native order.
    """
    builder, dtype = c.builder, as_dtype(kind.dtype)
    array = c.context.make_array(kind)(c.context, builder)
    fits = cgutils.alloca_once_value(builder, _is_array(given, c))

    def numbers(name: str) -> list[Any]:
        row = ir.ArrayType(_WORD, kind.ndim).as_pointer()
        place = builder.bitcast(_field(builder, given, _Array, name), row)
        return cgutils.unpack_tuple(builder, builder.load(place))

    with builder.if_then(builder.load(fits), likely=True):
        of = _field(builder, given, _Array, "dtype")
        found = _field(builder, given, _Array, "dimension")
        dimension = builder.icmp_unsigned("==", found, _INT(kind.ndim))
        found = _field(builder, of, _Dtype, "number")
        number = builder.icmp_unsigned("==", found, _INT(dtype.num))
        native = builder.icmp_unsigned("!=", _field(builder, of, _Dtype, "order"), _BYTE(_FOREIGN))
        builder.store(builder.and_(dimension, builder.and_(number, native)), fits)
    with builder.if_else(builder.load(fits), likely=True) as (right, wrong):
        with right:
            populate_array(
                array,
                data=builder.bitcast(_field(builder, given, _Array, "data"), array.data.type),
                shape=numbers("shape"),
                strides=numbers("strides"),
                itemsize=_WORD(dtype.itemsize),
                meminfo=None,
            )
        with wrong:
            expected = f"a kernel expected an array of {dtype} in {kind.ndim} dimensions."
            c.pyapi.err_set_string("PyExc_TypeError", expected)
    value = builder.load(array._getpointer())
    return NativeValue(value, is_error=builder.not_(builder.load(fits)))


def _is_array(given: Any, c: Any) -> Any:
    """Generate isinstance(given, np.ndarray), quick where it is one and of no subclass."""
    builder, name = c.builder, "numpy.ndarray"
    if name not in builder.module.globals:  # found out in the first call
        ndarray = cgutils.add_global_variable(builder.module, _PLACE, name)
        ndarray.linkage, ndarray.initializer = "internal", ir.Constant(_PLACE, None)
    ndarray = builder.module.globals[name]
    of = _field(builder, given, _Object, "type")
    same = builder.icmp_unsigned("==", of, builder.load(ndarray))
    found = cgutils.alloca_once_value(builder, same)
    with builder.if_then(builder.not_(same), likely=False):
        with builder.if_then(cgutils.is_null(builder, builder.load(ndarray)), likely=False):
            kept = c.pyapi.unserialize(c.pyapi.serialize_object(np.ndarray))
            builder.store(builder.bitcast(kept, _PLACE), ndarray)
        ask = cgutils.get_or_insert_function(
            builder.module, ir.FunctionType(_INT, [_PLACE, _PLACE]), "PyType_IsSubtype"
        )
        answer = builder.call(ask, [of, builder.load(ndarray)])
        builder.store(builder.icmp_unsigned("!=", answer, _INT(0)), found)
    return builder.load(found)


def _field(builder: Any, of: Any, structure: type[ctypes.Structure], name: str) -> Any:
    """Generate the reading of a field of a structure in memory: a pointer, an int or a byte."""
    field, kind = getattr(structure, name), dict(structure._fields_)[name]  # type: ignore[arg-type]
    read = {ctypes.c_void_p: _PLACE, ctypes.c_int: _INT, ctypes.c_byte: _BYTE}[kind]
    place = builder.gep(builder.bitcast(of, _PLACE), [_INT(field.offset)], inbounds=True)
    return builder.load(builder.bitcast(place, read.as_pointer()))
