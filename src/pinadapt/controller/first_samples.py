"""The torque against the momentum in the first samples: gravity that is added twice.

A gravity torque that the arm adds undeclared shows as soon as the arm moves; once it has moved as
it should, the test costs nothing. One that is declared and missing is learned like a load.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from ..exceptions import ImplausibleError
from ..records import Sensors
from ..robot.motors import Compensation, Gravity
from ..robot.robot import Robot

_CERTAIN = 5.0  # standard deviations of noise
_SHORTEST, _PERIODS, _LONGEST = 0.012, 12, 0.05  # [s], periods and [s] of a window
_VISIBLE = 0.1  # of gravity, below which the noise of a window should stay
_FALLS = 0.8  # of the gravity in question; wrong inertias of a half more or a third less show 0.5
_ASIDE = 0.5  # of what looks like gravity, that may be something else
_STILL = 0.5  # [rad/s^2 or m/s^2]: smaller accelerations by gravity show nothing
_WINDOWS = 3.0  # without a fault, after which the test is over
_PATIENCE = 20.0  # [s] that count as such a window where an arm rests
_TIME, _SUSPECT, _HEALTHY, _HEADER = range(4)
_SWITCH = "limits=pa.Limits(guards={'gravity': False}) switches this check off."


@dataclass(frozen=True, eq=False)
class FirstSamples:
    """The gravity torque in question, and windows in which the first samples show it.

    With g_a(q) that torque and M, C and g of the model without anything learned, a window of 12 ms
    (twelve periods, or up to 50 ms if noise asks for it) gives the share

        p = <r, g_a> / <g_a, g_a>,    r = M dv/dt + C v + g - tau,    <a, b> = a^T M^-1 b,

    with the slope of v and the torque sent, weighted as that slope weights it. An arm that adds g_a
    undeclared has p = 1 at its first motion, whatever its inertias. Refused
    is p above 0.8 and five standard deviations in two windows in a row, where r is along g_a; and a
    measured torque that differs so from the sent.

    Attributes:
        robot: as described, with the load announced at first.
        gravity: g_a of q (nq).
        window: its length [s].
        noise: (n) standard deviation of dv/dt over a window [rad/s^2 or m/s^2].
    """

    robot: Robot
    gravity: Gravity
    window: float
    noise: np.ndarray

    def init(self) -> np.ndarray:
        """Return the sums before any sample."""
        return np.zeros(_HEADER + 3 * self.noise.size)

    def after(
        self,
        sums: np.ndarray,
        q: np.ndarray,
        v: np.ndarray,
        sent: np.ndarray,
        measured: np.ndarray | None,
        dt: float,
    ) -> np.ndarray | None:
        """Return the sums with one more sample; None once the test is over.

        Args:
            sums: until then.
            q: (nq) configuration.
            v: (n) mean joint velocity since the sample before [rad/s or m/s].
            sent: (n) torque held since then [N m or N]; NaN: it is not known.
            measured: (n) the same as measured, or None.
            dt: since then [s].

        Raises:
            ImplausibleError: the arm adds its gravity torque undeclared.
        """
        if not dt > 0.0 or not np.isfinite(sent).all():
            return sums
        sums, T = sums.copy(), self.window
        swing, drive, offset = sums[_HEADER:].reshape(3, -1)
        middle = float(sums[_TIME]) + 0.5 * dt
        swing += dt * (middle - 0.5 * T) * v
        drive += dt * 0.5 * max(middle * (T - middle), 0.0) * sent
        if measured is not None and np.isfinite(measured).all():
            offset += dt / T * (measured - sent)
        sums[_TIME] += dt
        if sums[_TIME] < T - 0.5 * dt:
            return sums
        again, scale = bool(sums[_SUSPECT]), 12.0 / T**3
        suspect = self._suspect(q, v, scale * swing, scale * drive, offset)
        if suspect and again:
            raise self._error("v", suspect, "the arm accelerates")
        healthy = sums[_HEALTHY] + (1.0 if suspect == 0.0 else T / _PATIENCE)
        if healthy >= _WINDOWS:
            return None
        sums = self.init()
        sums[_SUSPECT], sums[_HEALTHY] = float(suspect or 0.0), healthy
        return sums

    def _suspect(
        self,
        q: np.ndarray,
        v: np.ndarray,
        a: np.ndarray,
        tau: np.ndarray,
        offset: np.ndarray,
    ) -> float | None:
        """Return the share of gravity that a window shows if it is too much, 0 if not.

        None where nothing shows: the arm rests, or gravity does not move it.
        """
        model, own = self.robot.model, self.gravity(q)
        M = pin.crba(model, model.createData(), q)
        falling = np.linalg.solve(M, own)
        if not np.abs(falling).max() > _STILL:
            return None
        size = float(own @ falling)

        def share(excess: np.ndarray) -> float:
            """Return the share of a torque (n) that is gravity; 0 if it is something else."""
            found = float(falling @ excess) / size
            rest = excess - found * own
            aside = float(rest @ np.linalg.solve(M, rest)) / size
            return found if aside < (_ASIDE * found) ** 2 else 0.0

        sensed = share(offset)
        if abs(sensed) > _FALLS:
            raise self._error("tau", sensed, "the measured torques differ from those sent")
        if not np.abs(a).max() > _STILL and not offset.any():
            return None
        friction = self.robot.friction_at(q).torque(v)
        drive = tau - friction - pin.rnea(model, model.createData(), q, v, np.zeros(v.size))
        noise = _CERTAIN * float(np.linalg.norm(own * self.noise)) / size
        seen = share(M @ a - drive)
        return seen if seen > _FALLS + noise else 0.0

    def _error(self, field: str, share: float, seen: str) -> ImplausibleError:
        other = "are the torques in another unit, or before the gears?" if field == "tau" else ""
        return ImplausibleError(
            field,
            f"{100.0 * share:.0f} %",
            f"shows that the arm adds its own gravity torque: {seen} by this share of it",
            other,
            'If so, declare it: compensated="nominal", in a scenario controller.compensated. '
            + _SWITCH,
        )


def make_first_samples(
    robot: Robot, unloaded: Robot, sensors: Sensors, compensation: Compensation | None, dt: float
) -> FirstSamples | None:
    """Return what the first samples of a robot are compared with.

    None where gravity is none, or is declared to be compensated.

    Args:
        robot: the nominal robot.
        unloaded: without the load announced at first.
        sensors: of the robot.
        compensation: torque that the arm is declared to add to the command, or None.
        dt: sampling period [s].
    """
    model = robot.model
    if compensation is not None or not np.any(model.gravity.linear):
        return None
    gravity = Gravity(unloaded)
    own = gravity(robot.q0)
    size = float(own @ np.linalg.solve(pin.crba(model, model.createData(), robot.q0), own))
    counts = np.broadcast_to(np.asarray(sensors.encoder, dtype=float), model.nv)
    angles = np.hypot(counts / math.sqrt(12.0), sensors.deviation("q"))
    periods = math.ceil(max(_SHORTEST / dt, _PERIODS) - 1e-9)
    while True:
        T = periods * dt
        noise = np.hypot(6.0 * math.sqrt(2.0) * angles / T**2, sensors.deviation("v") * math.sqrt(
            12.0 / (periods * T * T)
        ))  # fmt: skip
        share = _CERTAIN * float(np.linalg.norm(own * noise))
        if share <= _VISIBLE * size or T >= _LONGEST:
            return FirstSamples(robot.undrawn(), gravity, T, noise)
        periods += 1
