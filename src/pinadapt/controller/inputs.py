"""What comes into a step is checked here, every time, before anything is computed from it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from operator import attrgetter
from typing import Any

import numpy as np

from .._checks import instance, is_array, numbers, shown, vector
from ..exceptions import InputError, MeasurementError, ParameterError, PinadaptError
from ..models.task_kinematics import TaskKinematics
from ..records import Desired, DesiredSteps, Feet, Measurement
from .state import ControllerState


class InputCheck:
    """Sizes, types and states that fit one controller.

    Arrays of native floats and the right shape pass as they are, at the cost of one expression;
    others are converted, or refused by name. Whether numbers are finite is left
    to ``finite``, which is asked when a result is not.
    """

    def __init__(self, kinematics: TaskKinematics, dynamic_size: int) -> None:
        """Take the sizes to expect."""
        self._task = task = kinematics.task
        self._q = (kinematics.nq,)
        self._v = (kinematics.nv,)
        self._x = (task.coordinates,)
        self._m = (task.size,)
        self._estimates = (dynamic_size,), (kinematics.size,), (dynamic_size,)
        self._contacts = kinematics.robot.contacts

    def sample(
        self, state: ControllerState, measurement: Measurement, desired: Desired
    ) -> tuple[Measurement, Desired]:
        """Return measurement and desired motion as arrays of floats, copied only if necessary.

        Raises:
            MeasurementError: a signal that the law needs is missing, of the wrong size, or not
                made of numbers.
            InputError: the same of the desired motion, or the state is that of another controller.
        """
        try:
            t, q, v, x, x_time, xd, a, _, w = measurement
            (x_d, xd_d, xdd_d), (a_d, a_k, a_0) = desired, self._estimates
            fits = (
                state.__class__ is ControllerState
                and desired.__class__ is Desired
                and is_array(q, self._q)
                and is_array(v, self._v)
                and is_array(x_d, self._x)
                and is_array(xd_d, self._m)
                and is_array(xdd_d, self._m)
                and is_array(state.dynamic.value, a_d)
                and is_array(state.kinematic.value, a_k)
                and is_array(state.a_0, a_0)
                and (x is None or is_array(x, self._x))
                and (xd is None or is_array(xd, self._m))
                and (w is None or is_array(w, self._v))
                and (x_time is None or (x_time.__class__ is float and x_time - x_time == 0.0))
                and a is None
                and t.__class__ is float
                and t - t == 0.0
            )
        except (AttributeError, TypeError, ValueError):
            fits = False
        if fits:
            return measurement, desired
        self.state(state)
        return self.measurement(measurement), self.desired(desired)

    def state(self, given: ControllerState) -> None:
        """Refuse a state that does not fit.

        Raises:
            InputError: it is that of another controller.
        """
        instance(given, ControllerState, "state")
        estimates = (getattr(part, "value", part) for part in given[1:4])
        if not all(map(is_array, estimates, self._estimates)):
            raise InputError(
                "the state is that of another controller, or its estimates are no float arrays.",
                where="state",
            )

    def measurement(self, given: Measurement) -> Measurement:
        """Return the measurement as arrays of floats.

        Raises:
            InputError: no measurement.
            MeasurementError: a signal is missing, of the wrong size, or not made of numbers.
        """
        instance(given, Measurement, "measurement")
        if not self._task.positions:  # a joint task
            given = given._replace(x=None, x_time=None, xd=None)
        parts: dict[str, Any] = {"t": _number(given.t, "t"), "tau": given.tau}
        if given.x_time is not None:
            parts["x_time"] = _number(given.x_time, "x_time")
        shapes = self._q, self._v, self._x, self._m, self._v, self._v
        for name, shape in zip(("q", "v", "x", "xd", "a", "w"), shapes, strict=True):
            value = getattr(given, name)
            if value is not None or name in "qv":
                parts[name] = _array(value, shape, name)
        return Measurement(**parts)

    def time(self, given: Any) -> float:
        """Return a time [s], NaN if it is none."""
        try:
            return _number(given, "t")
        except MeasurementError:
            return math.nan

    def torque(self, given: Any) -> np.ndarray | None:
        """Return a measured torque (n) as an array of finite floats, None as it is.

        Raises:
            MeasurementError: of the wrong size, or not made of finite numbers.
        """
        if given is None:
            return None
        tau = _array(given, self._v, "tau")
        if not np.isfinite(tau).all():
            raise MeasurementError("tau", given)
        return tau

    def first(self, given: Measurement) -> Measurement:
        """Return the first measurement as arrays of finite floats; it must show where the frame is.

        Raises:
            InputError: no measurement.
            MeasurementError: a signal is missing, of the wrong size, or not made of finite numbers.
        """
        try:
            measurement = self.measurement(given)
            if measurement.x is None and self._task.positions:
                raise MeasurementError("x", None, "is missing, and the first sample needs it")
            self.finite(measurement)
        except MeasurementError as error:  # without the hint for a loop that runs
            raise MeasurementError(
                error.field,
                error.value,
                error.flaw,
                hint="Start from a measurement that has all signals, each of the right size.",
            ) from None
        return measurement

    def desired(self, given: Desired) -> Desired:
        """Return the desired motion as arrays of floats.

        Raises:
            InputError: no desired motion, of the wrong size, or not made of numbers.
        """
        instance(given, Desired, "desired")
        shapes = self._x, self._m, self._m
        try:
            desired = Desired(*map(_array, given, shapes, Desired._fields))
            if given.feet is None:
                return desired
            return DesiredSteps.of(desired, self._feet(given.feet))
        except MeasurementError as error:
            raise InputError(
                f"{error.flaw}, got {error.value!r}.", where=f"desired.{error.field}"
            ) from None

    def _feet(self, given: Feet) -> Feet:
        """Return the motion of the contacts as arrays of floats.

        Raises:
            InputError: of the wrong size, not made of numbers, or of a robot with soles.
        """
        instance(given, Feet, "desired.feet")
        if not self._contacts or any(contact.sole is not None for contact in self._contacts):
            raise InputError("only point contacts change.", where="desired.feet")
        c = len(self._contacts)
        stands = standing(given.stands, c, "desired.feet.stands")
        names = (f"feet.{name}" for name in Feet._fields[1:])
        return Feet(stands, *map(_array, given[1:], [(c, 3)] * 3, names))

    def finite(self, measurement: Measurement, desired: Desired | None = None) -> None:
        """Refuse numbers that are not finite, and quaternions that are not of unit length.

        Raises:
            InputError: in the desired motion.
            MeasurementError: in the measurement.
        """
        if desired is not None:
            if not all(np.isfinite(part).all() for part in (*desired, *(desired.feet or ()))):
                raise InputError(f"the desired motion is not finite: {desired}.", where="desired")
            if flaw := self._task.flaw(desired.x_d):
                raise InputError(f"{flaw}.", where="desired.x_d")
        measurement = measurement._replace(tau=self.torque(measurement.tau))
        for name, value in measurement._asdict().items():
            if value is not None and not np.isfinite(value).all():
                raise MeasurementError(name, value)
        if measurement.x is not None and (flaw := self._task.flaw(measurement.x)):
            raise MeasurementError("x", measurement.x, flaw)


def made_by(
    part: Any, method: str, given: tuple[Any, ...], shapes: Mapping[str, tuple[int, ...]]
) -> Any:
    """Return what a method of a law or an adaptation, perhaps a user's own, returns.

    Args:
        part: the law or adaptation.
        method: its name.
        given: its arguments.
        shapes: of the arrays of floats in what it returns, by their names there.

    Raises:
        InputError: they are of other shapes, no such arrays, or it cannot make them.
    """
    try:
        made = getattr(part, method)(*given)
        for name, shape in shapes.items():
            found = attrgetter(name)(made)
            if not is_array(found, shape):
                raise TypeError(f"{name} is {shown(found)}")
    except (PinadaptError, np.linalg.LinAlgError):
        raise
    except (AttributeError, IndexError, TypeError, ValueError) as reason:
        raise InputError(
            f"must return arrays of floats of the shapes {dict(shapes)}: {reason}.",
            where=f"{type(part).__name__}.{method}",
        ) from reason
    return made


def standing(given: Any, contacts: int, where: str) -> np.ndarray:
    """Return which contacts (c) stand, as an array.

    Raises:
        InputError: not as many bools.
    """
    stands = np.array(given, dtype=object)
    if stands.shape != (contacts,) or not all(isinstance(one, bool | np.bool_) for one in stands):
        raise InputError(f"expected {contacts} bools, got {shown(given)}.", where=where)
    return stands.astype(bool)


def _array(value: Any, shape: tuple[int, ...], name: str) -> np.ndarray:
    """Return a new array of native floats of this shape."""
    try:
        array = np.asarray(value)
    except ValueError:  # ragged
        array = np.zeros(())
    if array.shape != shape or array.dtype.kind not in "fiu":
        expected = " x ".join(map(str, shape))
        flaw = f"must be {expected} numbers, not {array.size} of {array.dtype}"
        raise MeasurementError(name, value, flaw)
    return array.astype(float)


def _number(value: Any, name: str) -> float:
    """Return a finite number."""
    try:
        number = math.nan if isinstance(value, str) else float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not math.isfinite(number):
        raise MeasurementError(name, value)
    return number


def squared(given: np.ndarray | None, size: int, where: str = "information") -> np.ndarray | None:
    """Return R^T R (p, p) of the rows R (r, p) of an information of ``size`` p, None for none.

    Raises:
        ParameterError: rows of another size, or not of finite numbers.
    """
    if given is None:
        return None
    rows = numbers(given, where, error=ParameterError)
    if rows.ndim != 2 or rows.shape[1] != size:
        raise ParameterError(
            f"expected rows of {size} numbers, one a parameter, got shape {rows.shape}.",
            where=where,
        )
    return rows.T @ rows


def initial_estimate(
    given: np.ndarray | None, default: np.ndarray, where: str, names: tuple[str, ...]
) -> np.ndarray:
    """Return an initial estimate as a new array, or refuse it."""
    if given is None:
        return default.copy()
    return vector(given, default.size, where, names=names, error=ParameterError, fills=False)
