"""The search for the exciting motion of largest information gain within all limits."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from .._checks import instance, keywords, positive, whole
from .._compiled import compile_all
from ..controller.controller import Controller
from ..exceptions import InputError, RobotError
from ..information.payload import described_robot
from ..models.frame_kinematics import FrameKinematics
from ..models.joint_effects import ALL
from ..models.joint_kinematics import JointKinematics
from ..models.task_kinematics import TaskKinematics
from ..robot.robot import Robot
from ..simulation.simulate import Progress, watched
from ..tasks.frame import TASKS
from ..tasks.joint import JointTask
from ..tuning.unknowns import Unknown, nominal_dynamics
from .aim import Aim
from .allowance import Allowance, configurations
from .exciting_motion import ExcitingMotion, LimitUse, RestToRest

_FASTEST = 0.5  # [Hz] of the harmonics, unless the duration is too short
_FEWEST, _MOST = 3, 8  # harmonics
_PER_HARMONIC, _FINE = 16, 120  # instants per harmonic, in the search and in the last check
_STARTS, _ITERATIONS = 24, 60
_PENALTY = 200.0  # [nat] for exceeding an allowance by its own size at all instants
_STEP = 1e-6  # of numerical derivatives [rad or m, and per s or s^2]
_BISECTIONS = 20  # in the last check


@keywords(
    dynamic='unknown=pa.Unknown(bodies="all")',
    joint="unknown=pa.Unknown(friction=True, armature=True)",
    kinematic="unknown=pa.Unknown(tool=True), with base, translations and lengths beside it",
)
def excite(
    robot: Robot | Controller,
    *,
    unknown: Unknown | str | Sequence[str] | None = None,
    duration: float = 10.0,
    harmonics: int | None = None,
    excursion: ArrayLike | None = None,
    load: float | None = None,
    seed: int = 0,
    progress: Progress | bool | None = None,
) -> ExcitingMotion:
    """Find a motion of the joints that identifies unknown parameters, within all limits.

    The motion is a Fourier series for each joint, from rest at home and back (Swevers and others,
    1997), with the largest expected information gain about the base parameters (see ``Aim``). It is
    found by quasi-Newton steps from the best of some random series.

    It stays away from the ends of each joint's range by a twentieth of it, uses at most four fifths
    of the velocity and effort limits, the latter with and without a load, and keeps joints and
    frame above the horizontal plane that the robot is mounted on. Collisions of the robot with
    itself are not checked: a smaller ``excursion`` avoids them.

    Args:
        robot: the nominal model, of any task, at its home; or a controller, whose unknown
            parameters are taken.
        unknown: what the motion is to excite, an ``Unknown`` or words for it; by default all
            bodies, friction and rotor inertias. Translations, ``tool`` among them, are those that a
            camera would show.
        duration: of the motion, and period of the series [s].
        harmonics: of the series, at least 2; by default as many as stay within half a hertz, from 3
            to 8.
        excursion: how far joints may move from home, one or one per joint [rad or m]; by default a
            quarter of a turn and half a metre.
        load: mass of the heaviest load at the frame [kg]; by default a tenth of the robot's mass,
            halved until the motors hold it at home.
        seed: of the random series.
        progress: as in ``simulate``.

    Raises:
        InputError: nothing is unknown, no motion identifies it, or impossible numbers.
        RobotError: home is outside the limits, or the motors cannot hold arm and load there.
    """
    compile_all()
    nominal, aim = _nominal_and_aim(robot, unknown)
    duration = positive(duration, "duration", error=InputError)
    if harmonics is None:
        harmonics = min(max(round(_FASTEST * duration), _FEWEST), _MOST)
    harmonics = whole(harmonics, "harmonics", 2)
    allowed = Allowance.of(nominal, excursion, load)
    search = _Search(aim, allowed, RestToRest(harmonics, duration, _PER_HARMONIC * harmonics))
    theta = search.best(whole(seed, "seed", 0), watched(range(_ITERATIONS), progress, "excite"))
    fine = RestToRest(harmonics, duration, _FINE * harmonics)
    check = _Search(aim, allowed, fine)
    theta = check.inside(theta)
    angles, q, v, a = check.states(theta)
    return ExcitingMotion(
        fine.series(nominal.home_angles, theta),
        duration,
        aim.excitation(q, v, a, duration),
        LimitUse.of(allowed, angles, q, v, a),
        (aim.dynamic, aim.kinematic),
        aim.information_gain(q, v, a, duration),
    )


def _nominal_and_aim(
    given: Robot | Controller, unknown: Unknown | str | Sequence[str] | None
) -> tuple[Robot, Aim]:
    """Return the nominal robot and its unknown parameters.

    Raises:
        InputError: unknown words, or no parameter that a motion identifies.
    """
    instance(given, Robot | Controller, "robot")
    if isinstance(given, Controller):
        if unknown is not None:
            raise InputError("a controller has its own unknown parameters.", where="unknown")
        nominal = described_robot(given)
        return nominal, Aim(nominal, given.dynamics, given.kinematics)
    nominal = given.undrawn()
    unknown = Unknown.of(unknown)
    dynamics = nominal_dynamics(nominal, unknown, ALL)
    translations = unknown.translation_words(tool=False)
    kinematics: TaskKinematics
    if not translations:
        kinematics = JointKinematics(replace(nominal, task=JointTask.of_chain(nominal.model)), ())
    else:
        in_joints = isinstance(nominal.task, JointTask)
        framed = replace(nominal, task=TASKS["xyz"]) if in_joints else nominal
        kinematics = FrameKinematics(framed, translations)
    return nominal, Aim(nominal, dynamics, kinematics)


class _Search:
    """Motions of coefficients theta (n, size), evaluated at the instants of a period."""

    def __init__(self, aim: Aim, allowed: Allowance, basis: RestToRest) -> None:
        """Take the unknown parameters, the allowance, and the family of motions."""
        self._aim, self._allowed, self._basis = aim, allowed, basis
        self._home = allowed.robot.home_angles

    def states(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return angles (N, n), configurations (N, nq), velocities and accelerations (N, n)."""
        displacement, v, a = self._basis.motion(theta)
        angles = self._home + displacement
        return angles, configurations(self._allowed.robot, angles), v, a

    def best(self, seed: int, iterations: Iterable[int]) -> np.ndarray:
        """Return the coefficients of largest gain, nearly within the allowance."""
        from scipy.optimize import minimize  # here, because scipy is slow to import

        rng, shape = np.random.default_rng(seed), (len(self._home), self._basis.size)
        starts = [self.inside(rng.standard_normal(shape)) for _ in range(_STARTS)]
        first = min(starts, key=self._negative_gain)
        size, steps = np.abs(first).max(), iter(iterations)

        def cost(z: np.ndarray) -> tuple[float, np.ndarray]:
            value, slope = self._cost(size * z.reshape(shape))
            return value, size * slope.ravel()

        next(steps, None)
        found = minimize(
            cost,
            (first / size).ravel(),
            jac=True,
            method="L-BFGS-B",
            callback=lambda _: next(steps, None),
            options={"maxiter": _ITERATIONS},
        )
        for _ in steps:  # complete the progress bar
            pass
        return np.asarray(size * found.x.reshape(shape))

    def inside(self, theta: np.ndarray) -> np.ndarray:
        """Return theta times the largest factor up to one whose motion keeps all limits.

        Raises:
            RobotError: no factor does.
        """
        if self._kept(theta):
            return theta
        low, high = 0.0, 1.0
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self._kept(middle * theta) else (low, middle)
        if not low:
            raise RobotError(
                "no motion from home keeps the limits.",
                where=self._allowed.robot.name,
                hint="Take another home pose, or a lighter load.",
            )
        return low * theta

    def _kept(self, theta: np.ndarray) -> bool:
        return self._allowed.kept(*self.states(theta))

    def _negative_gain(self, theta: np.ndarray) -> float:
        return -self._aim.information_gain(*self.states(theta)[1:], self._basis.period)

    def _cost(self, theta: np.ndarray) -> tuple[float, np.ndarray]:
        """Return the penalty for exceeded allowances minus the gain [nat], and its derivative.

        The derivative (n, size) is by differences in the 3 n states of each instant, fewer than the
        coefficients.
        """
        displacement, v, a = self._basis.motion(theta)
        now = np.stack([self._home + displacement, v, a])  # (3, N, n)
        count, n = v.shape
        shifts = _STEP * np.eye(3 * n).reshape(3 * n, 3, 1, n)
        states = np.concatenate([now[None], now + shifts]).transpose(1, 0, 2, 3)
        angles, v, a = states.reshape(3, -1, n)
        q = configurations(self._allowed.robot, angles)
        gain, changes = self._aim.gain_and_changes(q, v, a, self._basis.period, count)
        beyond = _PENALTY / count * np.sum(self._allowed.excess(angles, q, v, a) ** 2, axis=1)
        beyond = beyond.reshape(1 + 3 * n, count)
        slopes = (beyond[1:] - beyond[0] - changes.reshape(3 * n, count)) / _STEP
        return float(beyond[0].sum()) - gain, self._basis.derivative(slopes.reshape(3, n, count))
