"""What the first samples must agree with: joint limits, model, gravity.

A wrong unit, order or frame shows where the arm starts, gravity that is added twice or not at all
as soon as it moves; once it has moved as it should, they cost nothing. What every sample must agree
with is in ``sensing``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from .._kernels import samples as kernels
from ..description.chain import is_slide, position_limits
from ..exceptions import ImplausibleError
from ..models.task_kinematics import TaskKinematics
from ..records import Sensors
from ..robot.changes import Payload
from ..robot.motors import Compensation, Gravity
from ..robot.robot import Robot

# Beyond a joint limit a real arm may stand: by an angle [rad] or a length [m], and of the range.
_BEYOND, _BEYOND_SLIDE, _BEYOND_RANGE = math.radians(10.0), 0.02, 0.05
_MOST, _MOST_SLIDE = 8.0 * math.pi, 1e3  # [rad, m] of joints without limits
_ANOTHER_UNIT = 10.0  # [rad, m] from where on q is rather in degrees or millimetres
_OFF_CIRCLE = 0.02  # of cosine^2 + sine^2
_UNITS = {"millimetres": 1000.0, "centimetres": 100.0}
_UNEXPLAINED = 0.25  # of the reach, by which x may be where no unknown explains it
_TURNED = math.radians(30.0)  # of a measured orientation against that of the model
_TIGHT = 0.1  # of the reach: an order of joints that would fit
_NOISE = 5.0  # standard deviations
_WINDOW, _PERIODS = 0.012, 12  # [s] and periods, in which gravity is judged
_LONGEST_HALF, _VISIBLE = 0.025, 0.1  # [s], and share of gravity below which noise stays
_FALLS = 0.8  # of the acceleration that the gravity in question would cause
_SURE = 0.95  # thresholds above it are never reached
_ASIDE = 0.5  # of what looks like gravity, that may be something else
_HEALTHY, _WINDOWS = 0.5, 3.0  # share, and windows below it after which all is well
_MEASURED = 0.7  # of gravity, by which a measured torque differs from the one sent
_WEIGHTLESS = 0.5  # [rad/s^2 or m/s^2], accelerations by gravity too small to judge
_LIGHT, _HEAVY, _LOAD = 2.0 / 3.0, 1.5, 0.3  # what inertias and load may be, of those of the model
_SWITCH = "limits=pa.Limits(guards={{'{}': False}}) switches this check off."


class _Seen(NamedTuple):
    """The share of the gravity in question that a window shows, and whether that is too much."""

    share: float
    suspect: bool = False


@dataclass(frozen=True, eq=False)
class FirstSamples:
    """What is known of a robot before it moves, to compare its first samples with.

    Limits: a joint may stand beyond its limit by 10 degrees (a slide by 2 cm) and 5 % of its
    range; without limits within four turns (1 km).

    Position: x may be as far from x_hat(q) as the box of the unknown translations allows, and a
    quarter of the reach; a measured orientation may be off by 30 degrees.

    Gravity: with the arm's own gravity torque g_a(q) and the model's M, C and g without
    anything learned, each window of 12 ms (twelve periods, or up to
    50 ms if noise asks for it) gives the share

        p = <r, g_a> / <g_a, g_a>,    r = M dv/dt + C v + g - tau,    <a, b> = a^T M^-1 b,

    of torques held for the joints. An arm that adds g_a undeclared has p = 1 at its
    first motion, one that does not although declared p = -1: it falls freely, whatever its
    inertias. A model whose inertias are half too large has p = 1/2; a load makes p negative,
    but never falls faster than freely. Refused is |p| > max(0.8, (1 + p_0) / 2) + 5 sigma, with
    sigma that of the noise and p_0 the largest |p| of that sign of robots that differ from the
    model by inertias of 2/3 to 3/2, body by body, and a load of 30 %, under the same torques.
    Where p_0 exceeds 0.9, or r is not along g_a, nothing is refused; nor if |p| is below 0.8
    in the window after. A measured torque is compared with the
    one sent, also at rest; where the arm adds nothing, one in other units is refused as well.

    Attributes:
        robot: as described, with the load announced at first.
        position, limits: whether these are checked.
        box: (2, p) of the kinematic estimates [m].
        noise: of a measured position [m].
        tolerance, longest, half: of the kernel ``first_samples``.
        gravity: g_a of q (nq), or None to leave gravity alone.
        declared: whether the arm is declared to add it.
        acceleration: (n) standard deviation of dv/dt over a window [rad/s^2 or m/s^2].
        held: where in what is remembered the torque (n) stands that is held from the last
            sample on [N m or N]; NaN while it is unknown.
    """

    robot: Robot
    position: bool
    limits: bool
    box: np.ndarray
    noise: float
    tolerance: np.ndarray
    longest: float
    half: float
    gravity: Compensation | None
    declared: bool
    acceleration: np.ndarray
    held: slice

    def init(
        self, q: np.ndarray, x: np.ndarray | None, kinematics: TaskKinematics
    ) -> np.ndarray | None:
        """Return what there is to remember of the first samples, None for nothing.

        Args:
            q: (nq) the first configuration.
            x: the first task coordinates, or None.
            kinematics: updated to the sample.

        Raises:
            ImplausibleError: q is out of the joint limits, or x is not where this robot can be.
        """
        if self.limits and (flaw := misfit(self.robot.model, q)):
            raise ImplausibleError("q", q, flaw, hint=_SWITCH.format("limits"))
        if self.position and x is not None and kinematics.positions and kinematics.calibrated:
            self._check_place(q, x, kinematics)
        if self.gravity is None:
            return None
        first = np.zeros(kernels.HEADER + kernels.ROWS * self.robot.model.nv)
        first[self.held], first[kernels.JUDGED] = np.nan, 1.0
        return first

    def explained(self, kinematics: TaskKinematics) -> float:
        """Return how far x may be from x_hat [m] by what is unknown."""
        a_k, (low, high) = kinematics.a_k, self.box
        span = np.maximum(0.0, np.maximum(high - a_k, a_k - low))
        total, first = 0.0, 0
        for part in kinematics.translations:
            total += float(np.linalg.norm(part.directions, 2) * np.linalg.norm(
                span[first : first + part.size]
            ))  # fmt: skip
            first += part.size
        return total + _UNEXPLAINED * self.robot.reach + _NOISE * self.noise

    def _check_place(self, q: np.ndarray, x: np.ndarray, kinematics: TaskKinematics) -> None:
        """Refuse an x that is not where the model has it at q (nq), and no unknown explains it."""
        task, x_hat = kinematics.task, kinematics.x_hat
        place, expected = task.position_unchecked(x), task.position_unchecked(x_hat)
        apart, most = float(np.linalg.norm(place - expected)), self.explained(kinematics)
        if apart > most:
            unknown = ", ".join(part.name for part in kinematics.translations)
            names = f"that the unknown {unknown} can explain" if unknown else "that a model is off"
            raise ImplausibleError(
                "x",
                x,
                f"is implausible: {apart:.3g} m from where the model has the frame at this q, "
                f"{expected.round(3).tolist()}, more than the {most:.3g} m {names}"
                f"{self._why_there(q, place, expected, most, kinematics)}",
                hint="Give x in metres, in the axes and from the origin of the robot's base; if "
                "that is unknown, take unknown=pa.Unknown(base=True). "
                f"{_SWITCH.format('position')}",
            )
        if task.size == task.positions:
            return
        turned = _angle(task.error(x, x_hat))
        if turned > _TURNED:
            orders = {
                "wxyz? x in the order xyzw": x[[0, 1, 2, 4, 5, 6, 3]],
                "of the world in the frame? its conjugate": x * [1, 1, 1, -1, -1, -1, 1],
            }
            fits = [
                words
                for words, other in orders.items()
                if _angle(task.error(other, x_hat)) < _TURNED
            ]
            why = f" ({fits[0]} would fit)" if fits else " (the axes of another frame?)"
            raise ImplausibleError(
                "x",
                x,
                f"is implausible: turned by {math.degrees(turned):.0f} degrees from the model's "
                f"orientation at this q{why}",
                hint="The quaternion is xyzw, of the frame in the axes of the robot's base. "
                f"{_SWITCH.format('position')}",
            )

    def _why_there(
        self,
        q: np.ndarray,
        place: np.ndarray,
        expected: np.ndarray,
        most: float,
        kinematics: TaskKinematics,
    ) -> str:
        """Return what would explain a position that is too far away."""
        misses = [np.linalg.norm(place / factor - expected) for factor in _UNITS.values()]
        unit, factor = list(_UNITS.items())[int(np.argmin(misses))]
        if min(misses) <= most:
            return f" (in {unit}? x / {factor:g} would fit)"
        for words, order in _orders(self.robot).items():
            there = kinematics.task.position_unchecked(kinematics.at_unchecked(q[order])[0])
            if np.linalg.norm(place - there) <= _TIGHT * self.robot.reach:
                return f" (q in another order? {words} would fit)"
        return " (in another frame?)"

    def hear(self, first: np.ndarray, tau: Any, elapsed: float) -> None:
        """Add a measured torque (n) [N m or N] to what is remembered, if it is one.

        Args:
            first: with the sample at which it was measured, to be changed.
            tau: that the motors gave since the sample before.
            elapsed: since then [s].
        """
        n, tau = self.robot.model.nv, np.asarray(tau)
        usable = tau.shape == (n,) and tau.dtype.kind in "fiu" and np.isfinite(tau).all()
        known = usable and np.isfinite(first[self.held]).all()
        if known and first[kernels.JUDGED] and elapsed <= self.longest:
            first[kernels.HEARD] = 1.0
            _row(first, kernels.OFFSET, n)[:] += elapsed * (tau - first[self.held])

    def judge(self, found: int, first: np.ndarray, q: np.ndarray) -> np.ndarray | None:
        """Return what is kept for the next samples; None once the checks are complete.

        Args:
            found: not 0.
            first: what is remembered, to be changed.
            q: (nq) configuration.

        Raises:
            ImplausibleError: the arm adds its gravity torque undeclared, or the
                reverse.
        """
        if found == kernels.TOLD or not first[kernels.HEALTHY] < _WINDOWS:
            return None
        assert self.gravity is not None  # else nothing is remembered
        seen = self._gravity_share(first, q, self.gravity(q))
        first[kernels.SUSPECT] = float(seen.suspect)
        first[kernels.HEALTHY] += seen.share < _HEALTHY
        return first

    def _gravity_share(self, first: np.ndarray, q: np.ndarray, own: np.ndarray) -> _Seen:
        """Return the share of the gravity in question that a window shows.

        Raises:
            ImplausibleError: it is about all of it.
        """
        model, n = self.robot.model, self.robot.model.nv
        data, zero = model.createData(), np.zeros(n)
        time, earlier = float(first[kernels.TIME]), float(first[kernels.EARLIER])
        former, latter = _row(first, kernels.FORMER, n), _row(first, kernels.LATTER, n)
        a = (latter / (time - earlier) - former / earlier) / (0.5 * time)
        v = (former + latter) / time
        tau = _row(first, kernels.DRIVE, n) / first[kernels.WEIGHT]
        M = pin.crba(model, data, q)
        M = np.triu(M) + np.triu(M, 1).T
        falling = np.linalg.solve(M, own)
        size = float(own @ falling)
        if not np.abs(falling).max() > _WEIGHTLESS:
            return _Seen(0.0)
        sign = -1.0 if self.declared else 1.0
        if first[kernels.HEARD]:
            offset = _row(first, kernels.OFFSET, n) / time
            measured = sign * float(falling @ offset) / size
            rest = offset - sign * measured * own
            along = bool(rest @ np.linalg.solve(M, rest) < _ASIDE**2 * size)
            if measured > _MEASURED and along:
                raise self._gravity_error(measured, "the measured torques differ from those sent")
            if not self.declared and measured < -_MEASURED and along:
                raise _other_torques(1.0 + measured)
        friction = self.robot.friction_at(q).torque(v)
        drive = tau - friction - pin.rnea(model, data, q, v, zero)
        excess = M @ a - drive
        share = sign * float(falling @ excess) / size
        rest = excess - sign * share * own
        aside = float(rest @ np.linalg.solve(M, rest)) / size
        noise = _NOISE * float(np.linalg.norm(own * self.acceleration)) / size
        suspect = False
        if share > _FALLS + noise and aside < (_ASIDE * share) ** 2:
            if first[kernels.SUSPECT]:  # again
                raise self._gravity_error(share, "the arm accelerates")
            others = (
                pin.aba(other.model, other.model.createData(), q, v, tau - friction)
                for other in self._mistaken(q, own)
            )
            worst = max(sign * float(falling @ (M @ a - drive)) / size for a in others)
            threshold = max(_FALLS, 0.5 * (1.0 + worst))
            if threshold < _SURE and share > threshold + noise:
                suspect = True
        return _Seen(share, suspect)

    def _gravity_error(self, share: float, seen: str) -> ImplausibleError:
        if self.declared:
            return ImplausibleError(
                "v" if seen.startswith("the arm") else "tau",
                f"{100.0 * share:.0f} %",
                f"shows that the arm does not add the torque of `compensated`: {seen} as if this "
                "share of it were missing",
                hint="Omit `compensated` if the arm expects full torques, or switch its "
                f"compensation on. {_SWITCH.format('gravity')}",
            )
        return ImplausibleError(
            "v" if seen.startswith("the arm") else "tau",
            f"{100.0 * share:.0f} %",
            f"shows that the arm adds its own gravity torque: {seen} as if this share of it were "
            "added to the command",
            hint='If so, declare it: compensated="nominal", in a scenario controller.compensated. '
            f"{_SWITCH.format('gravity')}",
        )

    def _mistaken(self, q: np.ndarray, own: np.ndarray) -> Iterator[Robot]:
        """Yield plausible true robots: inertias off by a third, a load of 30 %.

        Args:
            q: (nq) at which the load is at its worst.
            own: (n) the gravity torque in question [N m or N].
        """
        robot, model = self.robot, self.robot.model
        n, zero = model.nv, np.zeros(model.nv)
        M = pin.crba(model, model.createData(), q)
        M = np.triu(M) + np.triu(M, 1).T
        pi = np.concatenate([body.toDynamicParameters() for body in model.inertias[1:]])
        weights = pin.computeJointTorqueRegressor(model, model.createData(), q, zero, zero) * pi
        parts = np.linalg.solve(M, own) @ weights.reshape(n, n, 10).sum(axis=2)
        names = robot.joint_names
        for light, heavy in ((_LIGHT, _HEAVY), (_HEAVY, _LIGHT)):
            yield robot.changed(inertial_scale=light)
            some = {
                name: light if part > 0.0 else heavy
                for name, part in zip(names, parts, strict=True)
            }
            yield robot.changed(inertial_scale=some)
        for scale in (1.0, _HEAVY):
            for axis in (*np.eye(3), *-np.eye(3)):
                load = Payload(_LOAD * scale * robot.mass, _TIGHT * robot.reach * axis)
                yield robot.changed(inertial_scale=scale, payload=load)


def _other_torques(ratio: float) -> ImplausibleError:
    """Return the error of measured torques that are a multiple of those sent."""
    return ImplausibleError(
        "tau",
        f"{ratio:.2f}",
        "is about this multiple of the commanded torque",
        "the wrong sign?"
        if ratio < -0.5
        else "in amperes? measured before the gear? not measured at all?",
        "Give the torques of the joints in N m or N, after the gears, or none. "
        f"{_SWITCH.format('gravity')}",
    )


def make_first_samples(
    robot: Robot,
    *,
    unloaded: Robot,
    on: Mapping[str, bool],
    tolerance: np.ndarray,
    box: np.ndarray,
    sensors: Sensors,
    compensation: Compensation | None,
    dt: float,
) -> FirstSamples:
    """Return what the first samples of a robot are compared with.

    Args:
        robot: the nominal robot.
        unloaded: without the load announced at first.
        on: whether a guard is on, by name.
        tolerance: (n) of ways [rad or m], see ``Guards``.
        box: (2, p) of the kinematic estimates [m].
        sensors: of the robot.
        compensation: torque that the arm is declared to add to the command, or None.
        dt: sampling period [s].
    """
    model, n = robot.model, robot.model.nv
    counts = np.broadcast_to(np.asarray(sensors.encoder, dtype=float), n)
    gravity: Compensation | None = None
    if on["gravity"] and (np.any(model.gravity.linear) or compensation is not None):
        gravity = Gravity(unloaded) if compensation is None else compensation
        if not _weighs(robot, gravity):
            gravity = None
    half, acceleration = _window(robot, gravity, counts, sensors, dt)
    return FirstSamples(
        robot=robot.undrawn(),
        position=on["position"],
        limits=on["limits"],
        box=box,
        noise=sensors.deviation("x"),
        tolerance=tolerance,
        longest=10.5 * dt,
        half=half,
        gravity=gravity,
        declared=compensation is not None,
        acceleration=acceleration,
        held=slice(kernels.HEADER + kernels.HELD * n, kernels.HEADER + (kernels.HELD + 1) * n),
    )


def _window(
    robot: Robot, gravity: Compensation | None, counts: np.ndarray, sensors: Sensors, dt: float
) -> tuple[float, np.ndarray]:
    """Return half a window [s], and the noise (n) of an acceleration over it [rad/s^2 or m/s^2].

    It is the shortest in which the noise leaves gravity visible at home, or the longest one.
    """
    model, periods = robot.model, math.ceil(max(0.5 * _WINDOW / dt, 0.5 * _PERIODS) - 1e-9)
    ways = math.sqrt(6.0) * np.hypot(counts / math.sqrt(12.0), sensors.deviation("q"))
    noise = 1.0
    if gravity is not None:
        M = pin.crba(model, model.createData(), robot.q0)
        own = gravity(robot.q0)
        noise = float(
            np.linalg.norm(own)
            / max(1e-9, own @ np.linalg.solve(np.triu(M) + np.triu(M, 1).T, own))
        )
    while True:
        half = periods * dt
        speeds = sensors.deviation("v") * math.sqrt(2.0 / periods)
        acceleration = np.hypot(ways / half**2, speeds / half)
        if _NOISE * noise * acceleration.max() < _VISIBLE or half >= _LONGEST_HALF:
            return half, acceleration
        periods += 1


def _weighs(robot: Robot, gravity: Compensation) -> bool:
    """Return whether gravity accelerates the joints anywhere; not those of a horizontal arm."""
    model, data = robot.model, robot.model.createData()
    for step in np.linspace(-1.0, 1.0, 5):
        q = pin.integrate(model, robot.q0, np.full(model.nv, step))
        M = pin.crba(model, data, q)
        M = np.triu(M) + np.triu(M, 1).T
        if np.abs(np.linalg.solve(M, gravity(q))).max() > _WEIGHTLESS:
            return True
    return False


def misfit(model: pin.Model, q: np.ndarray) -> str | None:
    """Return what is wrong with a configuration q (nq) by the joint limits, and why; or None."""
    flaw = _misfit(model, q)
    if flaw is None:
        return None
    slides = np.zeros(model.nq, dtype=bool)
    pairs = np.zeros(model.nq, dtype=bool)
    for joint in model.joints[1:]:
        slides[joint.idx_q] = is_slide(joint)
        pairs[joint.idx_q : joint.idx_q + joint.nq] = joint.nq == 2
    turns = ~(slides | pairs)
    units = {
        "in degrees? q * pi / 180": np.where(turns, math.pi / 180.0, 1.0),
        "in millimetres? q / 1000 of the slides": np.where(slides, 1e-3, 1.0),
        "in degrees and millimetres? both converted": np.where(
            turns, math.pi / 180.0, np.where(slides, 1e-3, 1.0)
        ),
    }
    if not pairs.any():
        for words, order in _orders(model).items():
            if _misfit(model, q[order]) is None:
                return f"{flaw} (in another order? {words} would fit)"
    for words, factor in units.items():
        changed = factor != 1.0
        far = changed.any() and np.abs(q[changed]).max() > _ANOTHER_UNIT
        if far and _misfit(model, factor * q) is None:
            return f"{flaw} ({words} would fit)"
    return flaw


def _misfit(model: pin.Model, q: np.ndarray) -> str | None:
    """Return which joint is where it cannot be, or None."""
    lower, upper = limit_margins(model)
    stated = position_limits(model)
    for joint in model.joints[1:]:
        i, at = joint.idx_v, joint.idx_q
        name, slide = model.names[joint.id], is_slide(joint)
        unit = "m" if slide else "rad"
        if joint.nq == 2:
            length = math.hypot(q[at], q[at + 1])
            if abs(length * length - 1.0) > _OFF_CIRCLE:
                return (
                    f"is impossible: of the continuous joint '{name}' it holds the cosine and the "
                    f"sine, and ({q[at]:.4g}, {q[at + 1]:.4g}) are those of no angle"
                )
            continue
        low, high = float(stated[0][i]), float(stated[1][i])
        if lower[i] <= q[at] <= upper[i]:
            continue
        if math.isinf(low):
            return f"is implausible: joint '{name}' at {q[at]:.4g} {unit}, over {upper[i]:.4g}"
        return (
            f"is out of the joint limits: joint '{name}' at {q[at]:.4g} {unit}, limits "
            f"{low:.4g} to {high:.4g}"
        )
    return None


def limit_margins(model: pin.Model) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest and highest q (n) at which a joint may stand [rad or m]."""
    low, high = position_limits(model)
    slides = np.array([is_slide(joint) for joint in model.joints[1:]])
    stated = np.isfinite(low)
    beyond, most = np.where(slides, _BEYOND_SLIDE, _BEYOND), np.where(slides, _MOST_SLIDE, _MOST)
    with np.errstate(invalid="ignore"):
        margin = beyond + _BEYOND_RANGE * (high - low)
    return np.where(stated, low - margin, -most), np.where(stated, high + margin, most)


def _orders(robot: Robot | pin.Model) -> dict[str, np.ndarray]:
    """Return the indices that put q (n) of another order of the joints into that of the chain."""
    model = robot.model if isinstance(robot, Robot) else robot
    if model.nq != model.nv:
        return {}
    names = [str(name) for name in model.names[1:]]
    alphabetical = sorted(names)
    rank = np.array([alphabetical.index(name) for name in names])
    orders = {"that of the joints from the last to the first": np.arange(len(names))[::-1]}
    if (rank != np.arange(len(names))).any():
        orders = {"the alphabetical one, of ROS,": rank, **orders}
    return orders


def _angle(error: np.ndarray) -> float:
    """Return the angle [rad] of a pose's error (6)."""
    return float(np.linalg.norm(error[3:]))


def _row(first: np.ndarray, row: int, n: int) -> np.ndarray:
    """Return one number a joint (n) of what is remembered, as a view."""
    start = kernels.HEADER + row * n
    return first[start : start + n]
