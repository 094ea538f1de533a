"""Every error is the same after copying and pickling; ``test_copies`` sends it to a process."""

import copy
import pickle

import numpy as np
import pytest

from pinadapt import exceptions
from pinadapt.exceptions import DivergedError, InputError, MeasurementError, PinadaptError


def kinds():
    """Return all classes of errors."""
    return [
        thing
        for thing in vars(exceptions).values()
        if isinstance(thing, type) and issubclass(thing, PinadaptError)
    ]


def example(kind):
    """Return an error of a class, all its attributes given."""
    if issubclass(kind, InputError):
        return kind("is negative.", where="robot.mass", hint="Take a positive one.")
    if issubclass(kind, MeasurementError):
        return kind("q", np.array([1.0, np.nan]), "is not finite")
    if issubclass(kind, DivergedError):
        return kind("the torque is not finite")
    return kind("something")


def same(a, b):
    """Return whether two errors have the same class, message and attributes."""
    return type(a) is type(b) and str(a) == str(b) and repr(vars(a)) == repr(vars(b))


@pytest.mark.parametrize("kind", kinds())
def test_copies_are_the_same(kind):
    error = example(kind)
    assert same(copy.copy(error), error) and same(copy.deepcopy(error), error)
    for protocol in range(pickle.HIGHEST_PROTOCOL + 1):
        assert same(pickle.loads(pickle.dumps(error, protocol)), error)
