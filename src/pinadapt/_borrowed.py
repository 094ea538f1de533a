"""Arrays that a kernel borrows: address, shape and strides, for the time of a call.

numba takes hold of every array by a reference of its own, allocated and freed in each call: 70 ns
an array, more than most kernels compute. The caller holds the arrays until the kernel returns, so
all that the kernel needs stands in the array object, whose layout is numpy's binary interface. The
code made here is part of each kernel on disk, which does not see a change of this file.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import NativeValue, models, register_model, unbox
from numba.np.arrayobj import populate_array
from numba.np.numpy_support import as_dtype

_WORD, _INT, _BYTE = ir.IntType(64), ir.IntType(32), ir.IntType(8)
_PLACE = _BYTE.as_pointer()
_FOREIGN = _BYTE(ord(">" if sys.byteorder == "little" else "<"))
# PyObject_HEAD, of which the type is the last word; PyArray_Descr: kind, type, byte order, flags,
# number; PyArrayObject: data, dimension, shape, strides, base, dtype
_HEAD = ir.ArrayType(_BYTE, object.__basicsize__ - 8), _PLACE
_DTYPE = ir.LiteralStructType([*_HEAD, _PLACE, *4 * [_BYTE], _INT])
_ARRAY = ir.LiteralStructType([*_HEAD, _PLACE, _INT, *3 * [_PLACE], _DTYPE.as_pointer()])


class Borrowed(types.Array):
    """An array of numba's that is not held by a reference."""


register_model(Borrowed)(models.ArrayModel)


@unbox(Borrowed)
def _unbox(kind: Borrowed, given: Any, c: Any) -> NativeValue:
    """Generate the code that makes of a Python object the array that a kernel computes with.

    It raises TypeError for anything but an array of this dimension and dtype, in native order.
    """
    builder, dtype = c.builder, as_dtype(kind.dtype)
    array = c.context.make_array(kind)(c.context, builder)
    fits = cgutils.alloca_once_value(builder, _is_array(given, c))
    head = builder.bitcast(given, _ARRAY.as_pointer())

    def numbers(index: int) -> list[Any]:
        row = ir.ArrayType(_WORD, kind.ndim).as_pointer()
        return cgutils.unpack_tuple(
            builder, builder.load(builder.bitcast(_field(builder, head, index), row))
        )

    with builder.if_then(builder.load(fits), likely=True):
        of = _field(builder, head, 7)
        dimension = builder.icmp_unsigned("==", _field(builder, head, 3), _INT(kind.ndim))
        number = builder.icmp_unsigned("==", _field(builder, of, 7), _INT(dtype.num))
        native = builder.icmp_unsigned("!=", _field(builder, of, 5), _FOREIGN)
        builder.store(builder.and_(dimension, builder.and_(number, native)), fits)
    with builder.if_else(builder.load(fits), likely=True) as (right, wrong):
        with right:
            populate_array(
                array,
                data=builder.bitcast(_field(builder, head, 2), array.data.type),
                shape=numbers(4),
                strides=numbers(5),
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
    of = _field(builder, builder.bitcast(given, _ARRAY.as_pointer()), 1)
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


def _field(builder: Any, of: Any, index: int) -> Any:
    """Generate the reading of a field of a structure."""
    return builder.load(cgutils.gep_inbounds(builder, of, 0, index))
