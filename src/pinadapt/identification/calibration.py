"""Calibration of a robot's geometry from measured positions or poses: ``calibrate``.

Each placement of the chain, of the joints and of the task frame, is the described one times a small
displacement exp(d), six numbers in the axes of what it places. A measured frame y then deviates by

    y - y(q) = sum over placements of K_i(q) d_i + noise,

to first order, K_i from Pinocchio's ``computeFrameKinematicRegressor``. Gauss-Newton steps move the
placements themselves, on SE(3), so that nothing of second order is left out in the end. A turn
about the axis of a joint, or a shift along that of a slide, is the offset of its encoder.

Some combinations have no effect on any frame: for each revolute joint the offset, which a turn of
the next placement undoes, and the shift along the axis; for each slide four; of parallel axes more
than that. Along these the description decides, as the mean of a prior. A QR factorisation with
column pivoting names them.

W. Khalil and E. Dombre, *Modeling, Identification and Control of Robots*, 2002, chapter 11, for
the method; M. Gautier and W. Khalil, *Direct calculation of minimum set of inertial parameters of
serial robots*, IEEE Trans. Robotics and Automation 6 (1990) 368-373, for the QR.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from threadpoolctl import threadpool_limits

from .._checks import flag, name_list, word
from .._output import Printed, Report, Table, as_json, write_json
from .._version import __version__
from ..exceptions import InputError, LogError
from ..information.information import estimate_table, gauss_newton, spread
from ..information.measured_motion import at_times, evenly
from ..information.tracker import LEAST_NOISE, LEAST_WAY, check_size, left_handed
from ..logs.formats import Source, read_log
from ..logs.import_options import Options
from ..logs.log import Log
from ..models.excited import rms
from ..models.linear_kinematics import DISPLACEMENTS, SHIFT, TURN, axes_of
from ..models.projected_kinematics import nearest_rotation
from ..models.tracker_kinematics import TRACKER
from ..models.translations import BASE, FIRST, TOOL, placement_of
from ..robot.changes import move_base
from ..robot.loading import load
from ..robot.robot import Robot
from ..tasks.frame import TASKS, FrameTask, matrix
from .logged_motion import several
from .report import plain

OFFSETS, JOINTS = "offsets", "joints"
ALL = (BASE, JOINTS, TOOL)
FILES = ("learned.urdf", "summary.json")

# of the motion, from which not even the calibrated robot explains it; half: the same verdicts;
# twice: frames of another clock are trusted
_WORST = 0.02
_OWN = "offset"


class FrameErrors(NamedTuple):
    """How far measured frames are from those of a model.

    Attributes:
        position: root mean square of the distance [m].
        largest: distance [m].
        turn: root mean square of the angle [rad]; None where x has no orientation.
    """

    position: float
    largest: float
    turn: float | None

    def words(self) -> str:
        """Return the numbers in mm and degrees."""
        text = f"{1e3 * self.position:.3g} mm"
        return text if self.turn is None else f"{text}, {math.degrees(self.turn):.3g} deg"


@dataclass(frozen=True, eq=False, repr=False)
class Calibration(Printed):
    """A robot with calibrated geometry; ``print`` shows a report.

    Attributes:
        described: the robot as described.
        robot: with the calibrated placements, x in the axes of its base. Offsets of encoders are
            part of the placements, so it takes joint positions as they are measured.
        tracker: placement of the base in the axes of x, if that was unknown; else None.
        names: (p) of the parameters: ``joint.shift_x``, ``joint.turn_x``, ``joint.offset``, in the
            axes of the joint; likewise of the tool and of the tracker.
        estimate: (p) of them, relative to the description, those of the tracker as ``tracker``
            [m or rad].
        deviations: (p) standard deviations, with the description as prior [m or rad]; those of the
            tracker are of the first joint, in the axes of x.
        prior: (p) standard deviations of the description [m or rad].
        combinations: the leading parameter of each combination that the motion identifies.
        noise: residual of a coordinate [m], and of an orientation [rad] or None.
        frames: how many were used.
        outliers: how many others were left out as impossible.
        before: error of the description in the held-out part. With an unknown tracker, of the
            described arm seen by the tracker that fits best.
        after: error of the robot that was calibrated without the held-out part, there.
        motion: rms distance of the frames from their mean [m].
        source: of the log.
    """

    described: Robot
    robot: Robot
    tracker: pin.SE3 | None
    names: tuple[str, ...]
    estimate: np.ndarray
    deviations: np.ndarray
    prior: np.ndarray
    combinations: tuple[str, ...]
    noise: tuple[float, float | None]
    frames: int
    outliers: int
    before: FrameErrors
    after: FrameErrors
    motion: float
    source: str

    @property
    def unidentified(self) -> tuple[str, ...]:
        """Names of the other parameters; along them the description decides."""
        return tuple(name for name in self.names if name not in self.combinations)

    @property
    def offsets(self) -> dict[str, tuple[float, float]]:
        """Joint name -> offset of its encoder and its deviation [rad or m].

        The offset is to be added to the measured position. Where a turn of the next joint's
        placement has the same effect, three times the deviation is granted to the offset, so that
        nine tenths of the effect are taken for it.
        """
        rows = zip(self.names, self.estimate.tolist(), self.deviations.tolist(), strict=True)
        end = f".{_OWN}"
        return {
            name.removesuffix(end): (value, known)
            for name, value, known in rows
            if name.endswith(end)
        }

    @property
    def trusted(self) -> bool:
        """Whether the calibrated robot explains the frames, held-out ones no worse than before."""
        # of held-out frames, whose rms scatters by some per cent
        return self.after.position <= min(1.2 * self.before.position, _WORST * self.motion)

    @property
    def verdict(self) -> str:
        """The result in one line."""
        words = f"error of held-out frames: {self.before.words()} -> {self.after.words()} (rms)"
        if self.trusted:
            return f"{words}."
        return (
            f"NOT TO BE TRUSTED: {words}, in a motion of {1e3 * self.motion:.3g} mm. Is x of this "
            "frame, of this robot, and timed on the clock of q? Are these enough frames?"
        )

    def report(self) -> Report:
        """Return what was measured, the parameters, and what the motion does not identify."""
        noise = FrameErrors(self.noise[0], np.nan, self.noise[1])
        summary = [
            ("frames", f"{self.frames}, {self.outliers} others left out as impossible"),
            ("identified by this motion", f"{len(self.combinations)} combinations"),
            ("identified only in combination", ", ".join(self.unidentified) or "-"),
            ("residual", f"{noise.words()} a coordinate"),
            ("largest held-out error", f"{1e3 * self.after.largest:.3g} mm"),
        ]
        slides = {f"{name}.{_OWN}" for name, yes in self.described.slides.items() if yes}
        units = ["m" if ".shift" in name or name in slides else "rad" for name in self.names]
        return Report(
            f"{self.described.name}, calibrated from {self.source}",
            [Table(summary), estimate_table(self.names, self.estimate, self.deviations, units)],
            self.verdict,
        )

    def summary(self) -> dict[str, Any]:
        """Return the record of ``summary.json``: its attributes but the robots, and the verdict."""
        whole = {
            "verdict": self.verdict,
            "trusted": self.trusted,
            **vars(self),
            "robot": self.described.name,
            "tracker": None if self.tracker is None else self.tracker.homogeneous,
            "version": __version__,
        }
        del whole["described"]
        return as_json(plain(whole))

    def save(self, folder: Path | str) -> None:
        """Write ``learned.urdf``, with the calibrated placements, and ``summary.json``.

        Raises:
            OSError: they cannot be written.
        """
        self.robot.save(Path(folder) / FILES[0])
        write_json(Path(folder) / FILES[1], self.summary())


@threadpool_limits.wrap(limits=1, user_api="blas")
def calibrate(
    log: Source | Sequence[Any],
    robot: Robot | Path | str,
    *,
    unknown: str | Sequence[str] = ALL,
    tracker: bool = False,
    import_options: Options | None = None,
) -> Calibration:
    """Calibrate the geometry of a robot from measured positions or poses of its frame.

    Blocks of time are held out once, to measure how well the rest predicts them; the result is the
    estimate from all frames. Up to 2000 frames are used, evenly chosen. A frame that is six
    standard deviations off the others is left out.

    Args:
        log: a file, folder or ``Log`` with q and x; torques are not needed; or several of these.
            x is a position (3) [m] or a pose with a quaternion xyzw (7). Ten to fifty
            configurations all over the workspace identify more than a long motion in a corner of
            it.
        robot: as it is described, a ``Robot`` or what ``load`` takes.
        unknown: placements: "base" for that of the first joint, "joints" for those of all others,
            "tool", or names of joints; "offsets" for the encoders alone.
        tracker: whether x is in axes of its own, anywhere; the placement of the first joint is then
            identified only relative to these, and stays as described.
        import_options: how logs are to be read, as of ``identify``.

    Raises:
        LogError: a log that cannot be used: without x, with too few frames, x in millimetres, in
            left-handed axes or turned against the base, or x that does not move with the arm.
        InputError: unknown words.
        RobotError: a robot that cannot be loaded, or has several task frames.
    """
    described = (robot if isinstance(robot, Robot) else load(robot)).in_base_axes
    described.check_single_frame()
    words = name_list(unknown, "unknown")
    logs = [
        read_log(source, described, import_options=import_options, torques=False)
        for source in several(log)
    ]
    name = ", ".join(one.source for one in logs)
    seen = _seen(logs, described, name)
    start = _start(described, seen, name, tracker=flag(tracker, "tracker"))
    placements = _Unknown(described, words, seen.task, start if tracker else None)
    whole = _Geometry(described, placements, start)
    kept, rows, _, noise = _fitted(whole, seen, name)
    held = np.arange(len(kept)) * _BLOCKS // len(kept) % 4 == 3  # a quarter of the blocks
    last = seen.only(kept & held)
    first = seen.only(kept & ~held)
    after = _Geometry(described, placements, start)
    _fitted(after, first, name, noise)
    alone = _Unknown(described, (), seen.task, start) if tracker else placements
    before = _Geometry(described, alone, start)
    if tracker:
        _fitted(before, first, name, noise)
    R = np.linalg.qr(np.vstack([rows, np.eye(len(placements.names))]), mode="r")
    return Calibration(
        described=described,
        robot=whole.robot(f"Placements calibrated from frames of {name}."),
        tracker=whole.tracker() if tracker else None,
        names=placements.names,
        estimate=whole.value(),
        deviations=np.linalg.norm(np.linalg.inv(R), axis=1) * placements.prior,
        prior=placements.prior,
        combinations=tuple(placements.names[k] for k in _identified(placements.along, rows)),
        noise=(float(noise[0]), float(noise[1]) if len(noise) > 1 else None),
        frames=int(np.count_nonzero(kept)),
        outliers=int(np.count_nonzero(~kept)),
        before=_errors(before, last),
        after=_errors(after, last),
        motion=math.sqrt(3.0) * spread(seen.x[:, :3]),
        source=name,
    )


# What was measured

# of time, some of which are held out; half, twice: held-out errors of other frames, by a sixth
_BLOCKS = 12
_TURNED = 0.5  # [rad] that no base is mounted off its description; half, twice: the same verdicts


class _MeasuredFrames(NamedTuple):
    """M measured frames.

    Attributes:
        task: coordinates of x: those of a position, or a pose.
        q: (M, nq) configurations when they were taken.
        x: (M, m) coordinates.
    """

    task: FrameTask
    q: np.ndarray
    x: np.ndarray

    def only(self, chosen: np.ndarray) -> _MeasuredFrames:
        """Return the frames of a mask (M)."""
        return self._replace(q=self.q[chosen], x=self.x[chosen])


def _seen(logs: Sequence[Log], robot: Robot, where: str) -> _MeasuredFrames:
    """Return the frames of logs, with the configurations when they were taken.

    Args:
        logs: with x.
        robot: as described.
        where: of the logs, for messages.

    Raises:
        LogError: there are none, or they have other coordinates than a position or a pose.
    """
    parts = []
    for log in logs:
        times, frames = log.frames()
        known = log.configurations(robot)
        finite = np.isfinite(known).all(axis=1)
        within, q, _ = at_times(robot.model, log.t[finite], known[finite], times)
        if within.any():
            parts.append((q, frames[within]))
    sizes = {x.shape[1] for _, x in parts}
    if sizes not in ({3}, {7}):
        raise LogError(
            "has no positions (3) or poses (7) of the frame at the times of q.",
            where=f"{where}: x",
            hint="Record x, y, z in metres, or with a quaternion xyzw; --columns x=NAME,... names "
            "them.",
        )
    q, x = (np.concatenate(part) for part in zip(*parts, strict=True))
    chosen = evenly(len(x), 2000)
    return _MeasuredFrames(TASKS["xyz" if sizes == {3} else "pose"], q[chosen], x[chosen])


def _start(robot: Robot, seen: _MeasuredFrames, where: str, *, tracker: bool) -> pin.SE3:
    """Return the placement of the base in the axes of x to begin with.

    It is the identity, or that which maps the described positions to the measured ones best
    (P. H. Schönemann, Psychometrika 31, 1966, 1-10).

    Raises:
        LogError: frames of another unit, of left-handed axes or of another point; or axes that are
            turned where they should be those of the base.
    """
    p = np.array([robot.placement(q).translation for q in seen.q])
    x = seen.x[:, :3]
    motion = spread(p)
    if motion < LEAST_WAY * robot.reach:
        raise LogError(
            f"the arm moves its frame by {1e3 * motion:.2g} mm (rms) only.",
            where=where,
            hint="Move every joint, such that the frame goes all over the workspace.",
        )
    both = (x - x.mean(axis=0)).T @ (p - p.mean(axis=0))
    R = nearest_rotation(both)
    mirror = -nearest_rotation(-both)
    straight, turned, mirrored = (spread(x - p @ part.T) for part in (np.eye(3), R, mirror))
    check_size(x, motion)
    if mirrored < 0.5 * turned:
        raise left_handed()
    if tracker:
        return pin.SE3(R, x.mean(axis=0) - R @ p.mean(axis=0))
    angle = np.linalg.norm(pin.log3(R))
    if angle > _TURNED and turned < 0.5 * straight:
        raise LogError(
            f"x is turned by {math.degrees(angle):.3g} deg against the base of the robot.",
            where=where,
            hint="If the tracker stands anywhere: tracker=True, or --tracker.",
        )
    return pin.SE3.Identity()


# What is unknown

# Times the deviations of a description: of the offset of an encoder. Half, twice: true errors the
# same to 0.5 %; a third: a TIAGo's training error 0.4 % larger.
_OFFSET = 3.0
# Times a tool's, which are a reach and a half turn: the deviations of the base in the axes of a
# tracker, so that a tool stays as described where the two cannot be told apart. Half, twice: the
# same geometries.
_ANYWHERE = 100.0


class _Unknown:
    """Unknown displacements of placements, p parameters.

    Attributes:
        names: (p) of the parameters.
        joints: (p) whose placement each displaces; of the tool their number.
        axes: (6, p) shift and turn, in the axes of what is placed.
        prior: (p) standard deviations of the description [m or rad].
        along: (p) whether they are along or about the axis of the joint.
        tracked: whether the first ones are of the base in the axes of a tracker.
    """

    def __init__(
        self, robot: Robot, words: Sequence[str], task: FrameTask, base: pin.SE3 | None
    ) -> None:
        """Take the displacements of the placements that a user's words name.

        Args:
            robot: as described.
            words: of the user.
            task: coordinates of x.
            base: first guess of its placement in the axes of a tracker; None: the axes are those of
                the base.

        Raises:
            InputError: an unknown word, or none.
        """
        model = robot.model
        for given in words:
            word(given, [BASE, JOINTS, TOOL, OFFSETS, *robot.joint_names], "unknown")
        found = []
        vague = np.repeat([robot.reach, math.pi], 3)
        for joint, name in enumerate(robot.joint_names, 1):
            axes, own = axes_of(model, joint)
            prior = np.repeat([SHIFT * robot.reach, TURN], 3)
            prior[own] *= _OFFSET
            if tracked := joint == FIRST and base is not None:
                axes = np.kron(np.eye(2), base.rotation @ model.jointPlacements[FIRST].rotation).T
                own = -1
                name = TRACKER
                prior = _ANYWHERE * vague
            whole = tracked or {name, BASE if joint == FIRST else JOINTS} & set(words)
            for k, label in enumerate(DISPLACEMENTS):
                if whole or (k == own and OFFSETS in words):
                    found.append(
                        (
                            f"{name}.{_OWN if k == own else label}",
                            joint,
                            axes[:, k],
                            prior[k],
                            not tracked and k % 3 == own % 3,
                        )
                    )
        if TOOL in words:  # a position does not show how a tool is turned
            for k, label in enumerate(DISPLACEMENTS[: task.size]):
                found.append((f"{TOOL}.{label}", model.njoints, np.eye(6)[k], vague[k], False))
        if not found:
            raise InputError(
                "nothing is unknown, so there is nothing to calibrate.", where="unknown"
            )
        self.names, *parts = zip(*found, strict=True)
        self.joints, columns, self.prior, self.along = map(np.array, parts)
        self.axes = columns.T
        self.tracked = base is not None


# The chain that is moved


class _Geometry:
    """A chain whose unknown placements are moved.

    Attributes:
        described: the robot as described.
        unknown: the displacements, p parameters.
        model: the chain, its base in the axes of x.
    """

    def __init__(self, robot: Robot, unknown: _Unknown, base: pin.SE3) -> None:
        """Use the unknown placements of a robot, its base at a placement in the axes of x."""
        self.described = robot
        self.unknown = unknown
        self.model = robot.model.copy()
        move_base(self.model, base)

    def _placements(self, model: pin.Model) -> Iterator[tuple[np.ndarray, pin.SE3, pin.SE3]]:
        """Yield the mask (p) of each placement's parameters, and views of it in both models."""
        for joint in np.unique(self.unknown.joints).tolist():
            of = None if joint == model.njoints else joint
            now, other = (
                placement_of(one, self.described.frame_id, of) for one in (self.model, model)
            )
            yield self.unknown.joints == joint, now, other

    def move(self, step: np.ndarray) -> None:
        """Move the placements by a step (p) of their displacements."""
        for own, place, _ in self._placements(self.model):
            moved = place * pin.exp6(self.unknown.axes[:, own] @ step[own])
            place.translation = moved.translation
            place.rotation = moved.rotation

    def value(self) -> np.ndarray:
        """Return how far each placement is from the description (p) [m or rad].

        That of a tracker is the placement of the base in its axes.
        """
        found = np.zeros(len(self.unknown.names))
        for own, now, described in self._placements(self.described.model):
            found[own] = self.unknown.axes[:, own].T @ _shift_and_turn(described.actInv(now))
        if self.unknown.tracked:
            found[:6] = _shift_and_turn(self.tracker())
        return found

    def robot(self, remark: str) -> Robot:
        """Return the described robot with these placements, but for that of the tracker."""
        model = self.described.model.copy()
        for own, now, place in self._placements(model):
            if not (self.unknown.tracked and own[0]):
                place.translation = now.translation
                place.rotation = now.rotation
        return replace(self.described, model=model, remark=remark)

    def tracker(self) -> pin.SE3:
        """Return the placement of the base in the axes of x, the first joint as described."""
        described = self.described.model.jointPlacements[FIRST]
        return self.model.jointPlacements[FIRST] * described.inverse()

    def rows(self, seen: _MeasuredFrames) -> tuple[np.ndarray, np.ndarray]:
        """Return measured less modelled coordinates of frames, and their regressors.

        Returns:
            (M, m), and (M, m, p) by the parameters. Orientations are compared by the vector phi of
            a turn, exp(phi) R = R_measured, in the axes of x.
        """
        model = self.model
        data = model.createData()
        unknown = self.unknown
        frame = self.described.frame_id
        r = np.zeros((len(seen.q), 6))
        W = np.zeros((len(seen.q), 6, len(unknown.names)))
        for k, (q, x) in enumerate(zip(seen.q, seen.x, strict=True)):
            pin.computeJointJacobians(model, data, q)
            at = pin.updateFramePlacement(model, data, frame)
            K = pin.computeFrameKinematicRegressor(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
            K = np.hstack([K, np.kron(np.eye(2), at.rotation)]).reshape(6, -1, 6)
            W[k] = np.einsum("ipk,kp->ip", K[:, unknown.joints - 1], unknown.axes)
            r[k, :3] = x[:3] - at.translation
            if len(x) > 3:
                r[k, 3:] = pin.log3(matrix(x[3:]) @ at.rotation.T)
        return r[:, : seen.task.size], W[:, : seen.task.size]


def _shift_and_turn(placement: pin.SE3) -> np.ndarray:
    """Return translation and rotation vector (6) of a placement [m, rad]."""
    return np.concatenate([placement.translation, pin.log3(placement.rotation)])


# The fit

# equations for each identified combination; half: fits without residuals, which tell no deviation,
# pass; twice: twice as many frames are asked for
_LEAST = 1.5
# Times the median deviation, from which a frame does not count: half leaves out one good frame of
# ten thousand, twice as much keeps frames of which one outweighs a hundred.
_OUTLIER = 6.0


def _fitted(
    geometry: _Geometry, seen: _MeasuredFrames, where: str, known: np.ndarray | None = None
) -> tuple[np.ndarray, ...]:
    """Move the placements of a geometry such that it fits frames best.

    The noise is that of the residuals, found along with the placements. Frames with residuals of
    more than six times the median do not count.

    Args:
        geometry: that is moved.
        seen: the frames.
        where: of the log, for messages.
        known: noise of a coordinate of the position [m] and of the orientation [rad], of frames
            that all count; None: it is to be found.

    Returns:
        kept (M), whether a frame is used; the rows (N, p) of the used frames, in units of their
        noise and of the prior; what is left of these (N); and the noise of a coordinate of the
        position [m], and of the orientation [rad] of poses.

    Raises:
        LogError: too few frames, or too many that do not fit.
    """
    prior = geometry.unknown.prior
    m = seen.task.size
    least = np.array([LEAST_NOISE * geometry.described.reach, LEAST_NOISE])[: m // 3]

    def fit() -> tuple[np.ndarray, ...]:
        """Return the equations at the placements as they are."""
        r, W = geometry.rows(seen)
        squares = np.mean(r.reshape(len(r), -1, 3) ** 2, axis=2)
        most = np.maximum(_OUTLIER**2 * np.median(squares, axis=0), least**2)
        kept = (squares <= most).all(axis=1) | (known is not None)
        noise = np.maximum(
            np.sqrt(np.mean(squares[kept], axis=0)) if known is None else known, least
        )
        sigma = np.repeat(noise, 3)
        rows = (W[kept] * prior / sigma[:, None]).reshape(-1, len(prior))
        squared = np.linalg.svd(rows, compute_uv=False) ** 2
        rank = np.sum(squared / (1.0 + squared))
        if _LEAST * rank > len(rows):
            raise LogError(
                f"{len(rows) // m} frames of {m} numbers are too few for {rank:.0f} combinations "
                "of the geometry.",
                where=where,
                hint=f"Record {math.ceil(2.0 * _LEAST * rank / m)} or more, or name fewer "
                "unknowns.",
            )
        share = 1.0 if known is not None else math.sqrt(1.0 - rank / len(rows))  # not explained
        return kept, share * rows, share * (r[kept] / sigma).ravel(), noise / share

    gauss_newton(
        lambda: (*fit()[1:3], -geometry.value() / prior),
        lambda step: geometry.move(step * prior),
        np.ones(len(prior)),
    )
    found = fit()
    lost = np.mean(~found[0])
    if lost > 0.2:
        raise LogError(
            "no geometry near the described one explains these frames: "
            f"{lost:.0%} of them do not fit the others.",
            where=where,
            hint="Is x of this frame, of this robot, and timed on the clock of q? Lost frames of a "
            "tracker are NaN, not 0.",
        )
    return found


# weight of columns that the QR is to take last; half, twice: the same geometries
_KEPT_LAST = 1e-4


def _identified(along: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Return the indices of the parameters that rows (N, p) identify where the others are known.

    A QR factorisation with column pivoting takes the parameters by turns: the one whose effect is
    farthest from those taken before is next. What is left when no effect is larger than the noise
    is not identified: to first order, a change of it and changes of the others cancel.
    Displacements along and about the axis of a joint are taken last.
    """
    from scipy.linalg import qr  # here, because scipy is slow to import

    last = np.where(along, _KEPT_LAST, 1.0)
    R, order = qr(rows * last, mode="r", pivoting=True)
    order = order[: min(R.shape)]
    return np.sort(order[np.abs(np.diag(R)) > last[order]])


def _errors(geometry: _Geometry, seen: _MeasuredFrames) -> FrameErrors:
    """Return how far frames are from those of a geometry."""
    r, _ = geometry.rows(seen)
    distances, *turns = np.linalg.norm(r.reshape(len(r), -1, 3), axis=2).T
    return FrameErrors(rms(distances), float(distances.max()), rms(turns[0]) if turns else None)
