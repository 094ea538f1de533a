"""The inertias of a Pinocchio model as one array, to be written at once."""

from __future__ import annotations

import ctypes
from itertools import pairwise

import numpy as np
import pinocchio as pin

_NUMBERS = (
    10  # of a pin.Inertia: mass, centre of mass, and the lower triangle of the inertia about it
)


def inertia_memory(model: pin.Model) -> np.ndarray | None:
    """Return a live array (n, 10) of the inertias of a chain's joints, or None where there is none.

    A row holds what ``pin.Inertia`` keeps: mass, centre of mass (3), and Ixx Ixy Iyy Ixz Iyz Izz
    about it. Writing two Python objects a body takes more time than the inverse dynamics; a control
    step writes all bodies in one kernel instead. Pinocchio gives out the centre of mass as a view
    on its own memory, from which the address of the rest follows; that the numbers there are the
    inertias is checked with numbers that are all different, before anything is ever written. The
    array is valid as long as the model is.
    """
    n = int(model.nv)
    if n != model.njoints - 1:
        return None
    tens = np.random.default_rng(0).uniform(1.0, 2.0, (n, _NUMBERS))
    kept = [body.copy() for body in model.inertias]
    for joint in range(1, n + 1):
        model.inertias[joint] = pin.Inertia.FromDynamicParameters(tens[joint - 1])
    memory = _array_at(model, n)
    found = memory is not None and all(
        np.array_equal(row, _stored(model.inertias[j])) for j, row in enumerate(memory, 1)
    )
    for joint, body in enumerate(kept):
        model.inertias[joint] = body
    return memory if found else None


def _array_at(model: pin.Model, n: int) -> np.ndarray | None:
    """Return the array (n, 10) that lies where the views on the centres of mass point to."""
    levers = [model.inertias[joint].lever for joint in range(1, n + 1)]
    size = np.dtype(float).itemsize
    places = [lever.__array_interface__["data"][0] - size for lever in levers]
    if any(b - a != _NUMBERS * size for a, b in pairwise(places)):
        return None
    numbers = (ctypes.c_double * (n * _NUMBERS)).from_address(places[0])
    return np.ctypeslib.as_array(numbers).reshape(n, _NUMBERS)


def _stored(body: pin.Inertia) -> np.ndarray:
    """Return the numbers (10) that an inertia is expected to keep, in order."""
    about = body.inertia
    lower = [about[i, j] for j in range(3) for i in range(j + 1)]
    return np.array([body.mass, *body.lever, *lower])
