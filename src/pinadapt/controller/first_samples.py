"""The torque against the momentum in the first samples: gravity that is added twice.

A gravity torque that the arm adds undeclared shows as soon as the arm moves; once it has moved as
it should, the test costs nothing. One that is declared and missing is learned like a load.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..exceptions import ImplausibleError
from ..models.joint_effects import expected_coefficients, typical_coefficients
from ..records import Sensors
from ..robot.motors import Gravity
from ..robot.robot import Robot

CERTAIN = 5.0  # standard deviations of what no noise explains: half: false alarms within seconds
# at 1 kHz, double: noise hides twice the fault
_WINDOW = 0.012  # [s]; half: six samples at 1 kHz show little in noise, double: the arm falls four
# times as far
_FALLS = 0.8  # of the gravity in question; wrong inertias of a half more or a third less show 0.5
# [rad/s^2 or m/s^2]: of smaller accelerations by gravity nothing shows; half, twice: the same runs;
# a hundred times: gravity that is not declared is missed
_STILL = 0.5
_WINDOWS, _PATIENCE = 3.0, 20.0  # without a fault, after which the test is over, and [s] that count
# as one where an arm rests; half: less of the motion is looked at, double: steps cost longer more


class Sums(NamedTuple):
    """Of a window of the first samples.

    Attributes:
        sent: (n) torque from the last sample on [N m or N]; None: nothing was sent yet.
        swing, drive: (n) sums of the velocity and of that torque.
        time: since the window began [s].
        suspect: the share of gravity that the window before showed.
        healthy: windows without a fault.
    """

    sent: np.ndarray | None
    swing: np.ndarray
    drive: np.ndarray
    time: float = 0.0
    suspect: float = 0.0
    healthy: float = 0.0


class FirstSamples:
    """The gravity torque in question, and windows in which the first samples show it.

    With g_a(q) that torque and M, C and g of the model without anything learned, a window of 12 ms
    (twelve periods, or up to four times as long if noise asks for it) gives the share

        p = <r, g_a> / <g_a, g_a>,    r = M dv/dt + C v + g - tau,    <a, b> = a^T M^-1 b,

    with the slope of v and the torque sent, weighted as that slope weights it. An arm that adds g_a
    undeclared has p = 1 at its first motion, whatever its inertias. Refused is p above 0.8 and five
    standard deviations in two windows in a row, where r is along g_a. Where dry friction of usual
    size could be that share of every joint's gravity torque, nothing shows.

    Attributes:
        robot: as described, with the load announced at first.
        gravity: g_a of q (nq).
        window: its length [s].
        noise: (n) standard deviation of dv/dt over a window [rad/s^2 or m/s^2].
        dry: (n) usual Coulomb friction [N m or N].
    """

    def __init__(self, robot: Robot, unloaded: Robot, sensors: Sensors, dt: float) -> None:
        """Take the robot as described, with and without its load, its sensors, and the period [s].

        A window has twelve periods or more, and is up to four times as long if its noise is more
        than a tenth of gravity.
        """
        model = robot.model
        self.robot = robot.undrawn()
        self.gravity = Gravity(unloaded)
        self.dry = expected_coefficients(robot, typical_coefficients(robot))[2]
        own = self.gravity(robot.q0)
        size = own @ np.linalg.solve(pin.crba(model, model.createData(), robot.q0), own)
        counts = np.asarray(sensors.encoder, dtype=float)
        # variance of the slope of v over T: that of q / T^4, and that of v / T^3
        of_q = 72.0 * (counts**2 / 12.0 + sensors.deviation("q") ** 2)
        of_v = 12.0 * dt * sensors.deviation("v") ** 2 * np.ones(model.nv)
        shortest = math.ceil(max(_WINDOW / dt, 12.0) - 1e-9)
        for periods in range(shortest, 4 * shortest + 1):
            self.window = T = periods * dt
            self.noise = np.sqrt(of_q / T**4 + of_v / T**3)
            if CERTAIN * np.linalg.norm(own * self.noise) <= 0.1 * size:
                break

    def init(self) -> Sums:
        """Return the sums before any sample."""
        none = np.zeros(self.noise.size)
        return Sums(None, none, none)

    def after(self, sums: Sums, q: np.ndarray, v: np.ndarray, dt: float) -> Sums | None:
        """Return the sums with one more sample; None once the test is over.

        Args:
            sums: until then, with the torque sent at the sample before.
            q: (nq) configuration.
            v: (n) mean joint velocity since the sample before [rad/s or m/s].
            dt: since then [s].

        Raises:
            ImplausibleError: the arm adds its gravity torque undeclared.
        """
        sent, swing, drive, time, suspect, healthy = sums
        if not dt > 0.0 or sent is None:
            return sums
        T = self.window
        middle = time + 0.5 * dt
        swing = swing + dt * (middle - 0.5 * T) * v
        drive = drive + dt * 0.5 * max(middle * (T - middle), 0.0) * sent
        time += dt
        if time < T - 0.5 * dt:
            return Sums(sent, swing, drive, time, suspect, healthy)
        share = self._share(q, v, 12.0 / T**3 * swing, 12.0 / T**3 * drive)
        if share and suspect:
            raise ImplausibleError(
                "v",
                f"{100.0 * share:.0f} %",
                "shows that the arm adds its own gravity torque: it accelerates by this share",
                hint='If so, declare it: compensated="nominal", in a scenario '
                "controller.compensated. limits=pa.Limits(guards={'gravity': False}) switches this "
                "check off.",
            )
        healthy += 1.0 if share == 0.0 else T / _PATIENCE
        if healthy >= _WINDOWS:
            return None
        return self.init()._replace(sent=sent, suspect=share or 0.0, healthy=healthy)

    def _share(self, q: np.ndarray, v: np.ndarray, a: np.ndarray, tau: np.ndarray) -> float | None:
        """Return the share of gravity that a window shows if it is too much, 0 if not.

        None where nothing shows: the arm rests, or gravity does not move it, or friction may.
        """
        model = self.robot.model
        own = self.gravity(q)
        data = model.createData()
        M = pin.crba(model, data, q)
        falling = np.linalg.solve(M, own)
        if not (np.abs(falling).max() > _STILL and np.abs(a).max() > _STILL):
            return None
        if (_FALLS * np.abs(own) <= self.dry).all():
            return None
        r = pin.rnea(model, data, q, v, a) + self.robot.friction_at(q).torque(v) - tau
        size = own @ falling
        share = falling @ r / size
        noise = CERTAIN * np.linalg.norm(own * self.noise) / size
        aside = r - share * own  # small where it is gravity
        along = aside @ np.linalg.solve(M, aside) < 0.25 * share**2 * size
        return share if along and share > _FALLS + noise else 0.0
