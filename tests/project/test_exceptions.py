"""Every error is the same after copying and pickling, as between processes."""

import copy
import pickle

import numpy as np
import pytest

from pinadapt import exceptions
from pinadapt.exceptions import DivergedError, InputError, MeasurementError, PinadaptError


def example(kind):
    """Return an error of a class, all its attributes given."""
    if issubclass(kind, InputError):
        return kind("is negative.", where="robot.mass", hint="Take a positive one.")
    if issubclass(kind, MeasurementError):
        return kind("q", np.array([1.0, np.nan]), "is not finite")
    if issubclass(kind, DivergedError):
        return kind("the torque is not finite")
    return kind("something")


KINDS = [each for each in vars(exceptions).values() if isinstance(each, type)]


@pytest.mark.parametrize("kind", [kind for kind in KINDS if issubclass(kind, PinadaptError)])
def test_copies_are_the_same(kind):
    error = example(kind)
    for other in (copy.copy(error), pickle.loads(pickle.dumps(error))):
        assert type(other) is kind and str(other) == str(error)
        assert repr(vars(other)) == repr(vars(error))
