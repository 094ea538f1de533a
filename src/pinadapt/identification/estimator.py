"""Estimates of a robot and its load beside any program that moves it, one sample at a time.

The equations are those of ``identify``: the motion averaged over overlapping windows phi, with the
momentum Y_M a + p_0 integrated by parts,

    int phi N (tau - tau_0 - Y_0 a) dt = - int (phi N)' (Y_M a + p_0) dt,

N the projection onto what no constraint force changes, one for a chain. Every window that agrees
with what was learned adds its products W^T W to those of its joint, so that noise and estimate
follow from all motion as they do offline, whenever they are asked for. Joints have all coefficients
of ``Friction``, near those of the description, and the last two may share a motor. While a joint
stands its friction may be anything up to Coulomb's, and its equation counts less.

A window that disagrees is set aside. If those after it agree again it was a push; if all of them
agree with another load, that is the load. A load is ten parameters of its own in the axes of the
body of the task frame; products of windows with an earlier one are kept with it eliminated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from .._checks import flag, instance, name_list, positive, word
from ..controller.inputs import InputCheck, standing
from ..description.floating_base import BASE_JOINTS
from ..exceptions import ImplausibleError, InputError, MeasurementError, RobotError
from ..information.measured_motion import FEWEST, LENGTH, OVERLAP, bump
from ..information.payload import PayloadEstimate, of_load, usual_load
from ..models.bodies import PAYLOAD, chosen_bodies, nearest_physical
from ..models.excited import rms
from ..models.joint_effects import KINDS, USUAL
from ..models.physical_fit import LEAST, PhysicalSet, physical_fit, physical_set
from ..models.regressor import LABELS, PER_BODY, random_states
from ..models.task_kinematics import JointKinematics
from ..plants.mujoco_plant import inertia_in, write_inertia
from ..records import Measurement
from ..robot.changes import Payload
from ..robot.constraints import repeated
from ..robot.robot import LOAD, Robot
from ..tuning.unknowns import Unknown, UnknownLike, nominal_dynamics
from .fits import FREE, LIGHT, TINY, WEIGHT, lasting_noise, noise_levels
from .selection import LEAST_GAIN, with_shafts

# [s] before and after a sample; half and twice: held-out errors of real logs the same to 2 %
_SMOOTH = 0.05
# [rad/s or m/s] of friction near rest; half and twice: that of a UR10 is 3 and 7 % larger
FADING = 0.1
# Windows of a load before it is accepted, longer than a push of half a second; half: accepted after
# 0.5 s in place of 0.9, and such a push may be; twice: after more than a second.
_LOADED = 12
_EVERY = 8  # windows between comparisons' estimates; half and twice: the same to 1 %
_RECENT = 75  # windows whose residuals tell how long errors last; half and twice: the same to 1 %
# Deviations at which a window disagrees; half: a UR10's error is 9 % larger; twice: the same.
_LIMIT = 3.0
_ROUNDS = 4  # of noise and friction near rest; half: a UR10's error is 5 % larger; twice: the same
_SHAKE = 0.2  # [rad or m], once a second; half and twice name the same joint
# Of the mass of a load, and of a hundredth of the robot's: above it motion is asked for; half and
# twice: for longer, and less long.
_KNOWN = 0.1
_DRY = "coulomb", "gear_friction", "asymmetry"
_GEAR = _DRY.index("gear_friction")


class _Rows(NamedTuple):
    """The equations at a sample; columns are those of the parameters, tau less y, tau and rest.

    Attributes:
        t: time [s].
        N: (n, n) projection; one of a chain.
        M: (n, c + 3) momentum.
        F: (n, c + 3) all else; rest is one where a joint stands, else zero.
    """

    t: float
    N: Any
    M: np.ndarray
    F: np.ndarray


class _Prediction(NamedTuple):
    """What new windows are compared with.

    Attributes:
        a: (p) parameters.
        columns: (e, 1 + p); the equations times the first one are the residual of a window, times
            the others a root of that residual's covariance.
        noise: (n) of the torque of a window [N m or N].
        lasting: (n) the same, as if windows were independent.
        windows: that are in it.
    """

    a: np.ndarray
    columns: np.ndarray
    noise: np.ndarray
    lasting: np.ndarray
    windows: int


class EstimatorState(NamedTuple):
    """All that an ``Estimator`` remembers; its arrays are never written.

    A window is an average [W y tau] (n, c + 2) of the equations W a = y, with the torque tau and y
    without its known part. Equations have e columns: those of W, ten of the load, and y.

    Attributes:
        samples: the last ones, as many as positions are smoothed over.
        begin: of the oldest open window [s].
        sums: (3, n, c + 3) over the open windows, the oldest first.
        last: equations at the last two samples, or middle ones; none: windows begin anew.
        products: of the windows with the present load, one for each joint, of its columns.
        past: (e, e) of all windows with other loads, in units of their noise.
        level: (n) sum of the squared torques of accepted windows.
        left: (n) sum of the squared residuals of windows with other loads.
        accepted: windows, those of them with the present load, and refused since the last
            one was accepted.
        recent: the last accepted windows.
        pending: windows that disagree.
        prediction: what windows are compared with; None at first.
        load: (10) centre of what may be carried; None: surely nothing.
        stands: (c) which contacts stand; None: all.
    """

    samples: tuple[Measurement, ...]
    begin: float
    sums: np.ndarray
    last: tuple[_Rows, ...]
    products: tuple[np.ndarray, ...]
    past: np.ndarray
    level: np.ndarray
    left: np.ndarray
    accepted: tuple[int, int, int]
    recent: tuple[np.ndarray, ...]
    pending: tuple[np.ndarray, ...]
    prediction: _Prediction | None
    load: np.ndarray | None
    stands: np.ndarray | None = None

    @property
    def t(self) -> float:
        """Time of the last sample [s]."""
        return self.samples[-1].t


@dataclass(frozen=True, eq=False)
class Estimate:
    """What was learned until a sample.

    Attributes:
        robot: with all that was learned, the load included.
        load: on the body of the task frame, of the first of several, in its axes; None: surely
            nothing. Its deviations cover neither gains of the torques nor, where the load alone is
            unknown, errors of the arm.
        names: of the parameters (p).
        a: (p) bodies without the load, the ten parameters of the load, coefficients of the joints.
        deviations: (p) of them.
        noise: (n) of the torque of a window, what friction's model leaves included [N m or N].
        advice: what would tell more; empty: nothing would tell much.
    """

    robot: Robot
    load: PayloadEstimate | None
    names: tuple[str, ...]
    a: np.ndarray
    deviations: np.ndarray
    noise: np.ndarray
    advice: str

    @property
    def model(self) -> pin.Model:
        """The robot's Pinocchio model."""
        return self.robot.model

    def save(self, path: Path | str) -> None:
        """Write the robot as URDF or MJCF, see ``Robot.save``.

        Raises:
            ParameterError: as there.
        """
        self.robot.save(path)

    def write(self, model: Any) -> None:
        """Write bodies, rotors and friction into a MuJoCo model of the same joints, in place.

        A body of the robot contains what the model's carries: what is welded to that loses its
        mass, and what other joints move, such as fingers, is subtracted where it is at ``qpos0``.
        Call ``mujoco.mj_setConst`` after it.

        Raises:
            KeyError: the model lacks a joint.
        """
        chain = self.robot.model
        friction = self.robot.friction
        names = self.robot.joint_names
        joints = {
            i: model.joint(name) for i, name in enumerate(names, 1) if name not in BASE_JOINTS
        }
        if names[0] in BASE_JOINTS:  # the free joint of the body that the others are on
            root = model.body_rootid[model.jnt_bodyid[model.joint(names[-1]).id]]
            joint = model.joint(max(model.body_jntadr[root], 0))
            if joint.type != 0:
                raise KeyError("the model has no free joint that carries the others")
            joints[len(BASE_JOINTS)] = joint
        own = [model.jnt_bodyid[joint.id] for joint in joints.values()]
        carriers = np.arange(model.nbody)
        for body, parent in enumerate(model.body_parentid):
            carriers[body] = body if body in own else carriers[parent]
        for (i, joint), at in zip(joints.items(), own, strict=True):
            label = model.body(at).name
            body = chain.inertias[i]
            if chain.existFrame(label):
                body = chain.frames[chain.getFrameId(label)].placement.actInv(body)
            welded = model.body_weldid == at
            for other in np.flatnonzero((carriers == at) & ~welded):
                body -= inertia_in(model, int(other), at)
            model.body_mass[welded] = 0.0
            model.body_inertia[welded] = 0.0
            write_inertia(model, at, body)
            if joint.name in names:
                dof = joint.dofadr[0]
                model.dof_armature[dof] = chain.armature[i - 1]
                model.dof_damping[dof] = friction.viscous[i - 1]
                model.dof_frictionloss[dof] = friction.coulomb[i - 1]

    def __str__(self) -> str:
        """Return the load and the advice."""
        load = self.load
        words = "no load"
        if load is not None:
            centre = ", ".join(
                f"{1e3 * c:.0f} +- {1e3 * d:.0f}"
                for c, d in zip(load.com, load.com_known_to, strict=True)
            )
            words = f"load {load.mass:.3f} +- {load.mass_known_to:.2g} kg at ({centre}) mm"
        return f"{words}; {self.advice}" if self.advice else words


class Estimator:
    """Bodies, load and friction of a robot from q, v and tau, whatever moves it.

    ``init`` and ``step`` are pure. Windows in which nothing moves are not read, as friction then
    hides the torque: a load that changes meanwhile is found when the robot moves. After a gap
    between samples windows begin anew.

    M. Shinbrot, *On the analysis of linear and nonlinear systems*, Trans. ASME 79 (1957) 547-552.

    Attributes:
        robot: as described.
        names: of the parameters (p).
        length: of a window [s].
    """

    def __init__(
        self,
        robot: Robot,
        unknown: UnknownLike = None,
        *,
        period: float = 1e-3,
        held: bool = True,
        smooth: bool = False,
    ) -> None:
        """Choose what is estimated.

        Args:
            robot: as described, a chain, a tree or a robot with constraints.
            unknown: "bodies" (the default) or "payload", as ``Unknown`` has it. With either the
                load is unknown, and friction unless ``Unknown`` states it. What an ``Unknown``
                names of bodies, the one with the load is among them.
            period: typical time between samples [s]. Windows begin anew where samples are further
                apart than two periods and 25 ms.
            held: whether tau is the mean since the last sample; else it is that of the instant.
            smooth: whether positions are smoothed over 0.1 s, and velocities are theirs: for noisy
                or missing v. Estimates are then 0.05 s late.

        Raises:
            InputError: words that cannot be used, unknown translations, or parameters that are not
                of bodies.
        """
        self.robot = instance(robot, Robot, "robot").undrawn()
        self._constraints = robot.constrained
        self._inputs = InputCheck(JointKinematics(robot), 0)
        self.length = max(LENGTH, FEWEST * positive(period, "period"))
        self._held = flag(held, "held")
        given = Unknown.of(unknown)
        if not isinstance(unknown, Unknown):
            for each in name_list(unknown or (), "unknown"):
                word(each, ("bodies", PAYLOAD), "unknown")
            given = replace(given, friction=None, armature=None)
        if words := given.translation_words(tool=False):
            raise InputError(
                f"positions of frames are not read, so {words} cannot be estimated.",
                where="unknown",
                hint="identify and calibrate find them from logs.",
            )
        carrier = robot.carriers[0]
        self._alone = alone = given.bodies == PAYLOAD
        bodies = sorted({*chosen_bodies(robot, given.bodies), carrier})
        chosen = replace(given.with_joints(), bodies=[robot.joint_names[i] for i in bodies])
        self._moving = np.flatnonzero(~np.isin(robot.joint_names, BASE_JOINTS))
        self._near = self._moving[:0]
        tried = list[str]()
        if given.friction is None:
            self._near = self._moving
            chosen = replace(chosen, effects=KINDS)
            if not robot.friction.shafts:  # a motor may turn with both joints of a wrist
                self.robot = with_shafts(self.robot, max(robot.model.nv - 2, 0))
                tried = [part.name(robot.joint_names) for part in self.robot.friction.shafts]
            ones = np.ones(robot.model.nv)
            self.robot = replace(
                self.robot,
                friction=replace(self.robot.friction, breakaway=ones, fading=FADING * ones),
            )
        rubbing = [robot.joint_names[j] for j in self._near]
        self.dynamics = dynamics = nominal_dynamics(self.robot, chosen, ())
        own = physical_set(dynamics, self.robot)
        size = dynamics.inertial.size
        self._own = PER_BODY * bodies.index(carrier) + np.arange(PER_BODY)
        self._dry = np.array(
            [[dynamics.names.index(f"{name}.{kind}") for kind in _DRY] for name in rubbing],
            dtype=int,
        ).reshape(-1, len(_DRY))
        # gears rub under the load, too; constraints would mix their shares
        carried = dynamics.size + self._dry.size
        self._fading = np.arange(dynamics.size, carried).reshape(self._dry.shape)
        geared = 0 if robot.constraints else len(rubbing)
        self._columns = carried + PER_BODY * geared
        self._carried = np.arange(carried, self._columns).reshape(-1, PER_BODY)
        # the equations have those of the carrier once more, for the load
        self._loaded = self._columns + np.arange(PER_BODY)
        self._order = np.insert(np.arange(self._columns + 1), self._columns, self._own)
        # parameters: bodies, the load, coefficients of the joints, their friction near rest
        kept = np.delete(np.arange(dynamics.size), self._own if alone else [])
        first = size - PER_BODY * alone
        self._load = slice(first, first + PER_BODY)
        listed = [dynamics.names[i] for i in kept]
        listed[first:first] = [f"load.{label}" for label in LABELS]
        self.names = (*listed, *(f"{name}.breakaway" for name in rubbing))
        self._rubbing = self._dry + first + PER_BODY - size
        self._gears, self._shares = (part[:geared, [_GEAR]] for part in (self._dry, self._rubbing))
        self._wrist = [self.names.index(f"{name}.{kind}") for name in tried for kind in USUAL]
        p = len(self.names)
        self._rest = np.arange(p - len(rubbing), p)
        self._least = np.full(p, -np.inf)  # friction near rest is not negative
        self._least[self._rest] = -1.0
        # the equations times B are those in the parameters, but for products of two of these
        self._B = np.zeros((len(self._order), p + 1))
        columns = np.insert(kept, first, self._loaded)
        self._B[columns, np.arange(len(columns))] = 1.0
        self._B[-1, -1] = 1.0
        if alone:
            self._B[self._own, -1] = -dynamics.initial[self._own]
        self._usual = usual_load(robot)
        center = np.insert(own.center[kept], first, self._usual)
        # the share of a gear may be typical; any dry or viscous friction is likely
        above_zero = slice(size, dynamics.size - len(own.scales))
        shares = [name.endswith(".gear_friction") for name in dynamics.names[above_zero]]
        typical = dynamics.initial[above_zero] / dynamics.typical[above_zero]
        center[self._wrist] *= LEAST  # hardly any, until the motion shows it
        count = first // PER_BODY
        self._physical = PhysicalSet(
            count + 1,
            np.append(center, np.zeros(len(rubbing))),
            np.where(shares, typical, LIGHT),
            np.append(np.ones(count), FREE),
            np.append(own.scales, np.ones(len(rubbing))),
        )
        self._T, _ = self._physical.local(self._physical.center)
        # which columns the equation of a joint has
        q, v, _ = random_states(robot.model, 1)[0]
        rows = self._rows(Measurement(0.0, q, v, tau=0.0 * v))
        found = (rows.M != 0.0) | (rows.F != 0.0) | bool(robot.constraints)
        found[:, self._columns] = True
        self._places = [np.flatnonzero(one) for one in found[:, self._order]]
        # under constraints fewer equations than joints are independent
        none = np.zeros(robot.model.nv)
        free, _ = self._constraints.free(robot.q0, none)
        self._repeated = repeated(free)
        # what a state has learned at first
        e = len(self._order)
        self._nothing: dict[str, Any] = {
            "products": tuple(np.zeros((len(at), len(at))) for at in self._places),
            "past": np.zeros((e, e)),
            "level": none,
            "left": none,
            "accepted": (0, 0, 0),
            "recent": (),
            "pending": (),
            "prediction": None,
        }
        self._count = 2 * max(round(_SMOOTH / period), 2) + 1 if flag(smooth, "smooth") else 1
        self._period = period

    def init(self, measurement: Measurement) -> EstimatorState:
        """Return the state at the first sample.

        Args:
            measurement: with q and v; with tau too if it is that of the instant.

        Raises:
            MeasurementError: a signal is missing, of the wrong size, or not finite.
        """
        sums = np.zeros((OVERLAP, self.robot.model.nv, self._columns + 3))
        if self._held and instance(measurement, Measurement, "measurement").tau is None:
            measurement = measurement._replace(tau=np.zeros(self.robot.model.nv))
        first = self._checked(measurement)
        return self._advance(
            EstimatorState((), first.t, sums, (), load=self._usual, **self._nothing), first
        )

    def announce(self, state: EstimatorState, payload: Payload | None) -> EstimatorState:
        """Return the state after another load was taken up, as a tool changer tells.

        Args:
            state: before.
            payload: that is carried now, which is then estimated from there, in the axes of the
                task frame; without mass: surely nothing; None: it is unknown.

        Raises:
            RobotError: an impossible load.
        """
        # no window holds both loads
        state = self._own_state(state)._replace(samples=state.samples[-1:], last=())
        instance(payload, Payload | None, "payload", RobotError)
        if payload is None:
            return self._begin_load(state, self._usual)
        placement = self.robot.model.frames[self.robot.frame_id].placement
        load = placement.act(payload.spatial_inertia()).toDynamicParameters()
        load = nearest_physical(load, least_radius=LOAD * self.robot.reach)
        return self._begin_load(state, load if payload.present else None)

    def step(
        self, state: EstimatorState, measurement: Measurement, stands: np.ndarray | None = None
    ) -> EstimatorState:
        """Return the state after a sample.

        Args:
            state: of ``init`` or the last step.
            measurement: as of ``init``.
            stands: (c) which contacts stand, points all of them; None: as at the last sample, all
                at first.

        Raises:
            MeasurementError: a signal is missing, of the wrong size, or not finite.
            ImplausibleError: the time is not after the last one's.
            InputError: no state of this estimator, not as many contacts, or samples that are
                smoothed and twice as far apart as the period says, or half.
        """
        now = self._checked(measurement)
        known = self._own_state(state).stands
        if stands is not None:
            stands = standing(stands, len(self.robot.contacts), "stands")
            if known is None or (stands != known).any():  # no window holds both
                state = state._replace(samples=state.samples[-1:], last=(), stands=stands)
        if now.t <= state.t:
            raise ImplausibleError("t", now.t, f"is not after the last sample's, {state.t:g} s")
        if now.t - state.t > 2.0 * self.length / FEWEST:
            state = state._replace(samples=(), last=())
        return self._advance(state, now)

    def _own_state(self, state: EstimatorState) -> EstimatorState:
        """Return a state of this estimator."""
        sums = instance(state, EstimatorState, "state").sums
        if sums.shape[1:] != (self.robot.model.nv, self._columns + 3):
            raise InputError("is that of another estimator.", where="state")
        return state

    def _advance(self, state: EstimatorState, sample: Measurement) -> EstimatorState:
        """Return the state after a sample that was checked."""
        samples = (*state.samples, sample)[-self._count :]
        state = state._replace(samples=samples)
        if len(samples) < self._count:
            return state
        middle = samples[0] if self._count == 1 else self._smoothed(samples)
        now = self._rows(middle, state.stands)
        if not state.last:
            return state._replace(begin=now.t, sums=0.0 * state.sums, last=(now, now))
        before, last = state.last
        # the last sample is complete, as the time until the next one is known
        middles = state.begin + self.length * (0.5 + np.arange(OVERLAP) / OVERLAP)
        phi, rate = bump(last.t - middles, self.length)
        share = 0.5 * (now.t - before.t)
        F = share * np.dot(last.N, last.F) - 0.5 * np.dot(now.N - before.N, last.M)
        M, F[:, -1] = np.dot(last.N, last.M), share * last.F[:, -1]
        if self._held:
            F[:, -2] = 0.0
        sums = state.sums + phi[:, None, None] * F - (share * rate)[:, None, None] * M
        if self._held:
            between = bump(0.5 * (last.t + now.t) - middles, self.length)[0] * (now.t - last.t)
            sums[:, :, -2] += np.outer(between, np.dot(0.5 * (last.N + now.N), now.F[:, -2]))
        state = state._replace(sums=sums, last=(last, now))
        if now.t < state.begin + self.length:
            return state
        state = state._replace(
            begin=state.begin + self.length / OVERLAP,
            sums=np.concatenate([sums[1:], 0.0 * sums[:1]]),
        )
        if not (sums[0, self._moving, -1] < 0.5).any():
            return state
        return self._compare(state, self._weighted(state, sums[0]))

    def _weighted(self, state: EstimatorState, found: np.ndarray) -> np.ndarray:
        """Return the window of sums (n, c + 3), in which a joint at rest counts less.

        What stands has any friction up to f: over the share r of a window that leaves a deviation
        r f of the torque, beside its noise.
        """
        known, tau, rest = found[:, -3:].T
        a, (noise, _) = self._physical.center, noise_levels(tau[None])
        if state.prediction is not None:
            a = state.prediction.a
            noise = state.prediction.noise
        coulomb = self.robot.friction.coulomb.copy()
        coulomb[self._near] = a[self._rubbing[:, 0]]
        weight = 1.0 / np.hypot(1.0, rest * coulomb / (noise + TINY))
        return weight[:, None] * np.column_stack([found[:, :-3], tau - known, tau])

    def _checked(self, measurement: Measurement) -> Measurement:
        """Return a measurement as new arrays of finite floats."""
        instance(measurement, Measurement, "measurement")
        if measurement.v is None and self._count > 1:
            measurement = measurement._replace(v=np.zeros(self.robot.model.nv))
        found = self._inputs.measurement(measurement)
        self._inputs.finite(found)
        if found.tau is None:
            raise MeasurementError("tau", None, "is missing")
        return found._replace(tau=self._inputs.torque(found.tau))

    def _smoothed(self, samples: Sequence[Measurement]) -> Measurement:
        """Return the middle sample, on cubics through the positions around it."""
        middle = samples[self._count // 2]
        model = self.robot.model
        t = np.array([one.t for one in samples]) - middle.t
        mean = (t[-1] - t[0]) / (self._count - 1)
        if not 0.5 <= mean / self._period <= 2.0:
            raise InputError(
                f"is {self._period:g} s, and samples come every {mean:.3g} s.", where="period"
            )
        moved = np.array([pin.difference(model, middle.q, one.q) for one in samples])
        *_, slope, value = np.polyfit(t, moved, 3)
        return middle._replace(q=pin.integrate(model, middle.q, value), v=slope)

    def _rows(self, measurement: Measurement, stands: np.ndarray | None = None) -> _Rows:
        """Return the equations at a sample."""
        robot = self.robot
        t, q, v, *_, tau, _ = measurement
        Y_M, Y_0, p_0, tau_0 = self.dynamics.momentum(q, v)
        M, F = np.zeros((2, len(v), self._columns + 3))
        size = self.dynamics.size
        M[:, :size], M[:, -3], F[:, :size], F[:, -3] = Y_M, p_0, Y_0, tau_0
        F[:, -2], F[:, -1] = tau, np.abs(v) < robot.friction.threshold
        near = self._near[:, None]
        F[near, self._fading] = np.exp(-np.abs(v[near]) / FADING) * Y_0[near, self._dry]
        if self._carried.size:
            _, g, _, g_0 = self.dynamics.momentum(q, 0.0 * v)
            bodies = self.dynamics.inertial.size
            signs = np.sign(g[:, :bodies] @ self.dynamics.initial[:bodies] + g_0)
            signs *= np.tanh(v / robot.friction.threshold)
            F[near, self._carried] = (signs[:, None] * g[:, self._own])[self._near]
        N = self._constraints.free(q, v, stands)[0] if robot.constraints else 1.0
        return _Rows(t, N, M, F)

    def _compare(self, state: EstimatorState, found: np.ndarray) -> EstimatorState:
        """Return the state after a window, added or set aside."""
        prediction = state.prediction
        if prediction is None or (not state.pending and self._agree([found], prediction)):
            return self._add(state, [found])
        total, present, refused = state.accepted
        pending = (*state.pending, found)
        state = state._replace(pending=pending[-_LOADED:], accepted=(total, present, refused + 1))
        latest = pending[-OVERLAP:]
        if len(pending) > OVERLAP and self._agree(latest, prediction):  # it was a push
            return self._add(state, latest)
        later = pending[OVERLAP:]
        if len(pending) >= _LOADED:
            other = self._begin_load(state, self._usual)
            if other.prediction is not None and self._agree(later, other.prediction):
                return self._add(other, later)
        if refused >= total:  # what was learned is contradicted for longer than it was supported
            return self._add(state._replace(**self._nothing), later)
        return state

    def _add(self, state: EstimatorState, windows: Sequence[np.ndarray]) -> EstimatorState:
        """Return the state that learned from windows."""
        total, present, _ = state.accepted
        state = state._replace(
            products=tuple(
                old + rows.T @ rows
                for old, rows in zip(state.products, self._each(windows), strict=True)
            ),
            level=sum((one[:, -1] ** 2 for one in windows), state.level),
            accepted=(total + len(windows), present + len(windows), 0),
            recent=(*state.recent, *windows)[-_RECENT:],
            pending=(),
        )
        learned = state.accepted[0] - (0 if state.prediction is None else state.prediction.windows)
        if learned < max(_EVERY, state.accepted[1] // _EVERY):
            return state
        return state._replace(prediction=self._predict(state))

    def _begin_load(self, state: EstimatorState, load: np.ndarray | None) -> EstimatorState:
        """Return the state with another load, of which nothing but its prior is known."""
        if state.accepted[1]:
            prediction = state.prediction or self._predict(state)
            at = self._loaded
            S = self._under_load(state, prediction.a)
            M = S.T @ self._sums(state, prediction.lasting) @ S
            if state.load is not None:
                known = np.zeros((PER_BODY, len(M)))
                known[:, at], known[:, -1] = np.eye(PER_BODY), state.load
                known = np.linalg.solve(self._T[self._load, self._load], known)
                M += known.T @ known
                M -= M[:, at] @ np.linalg.solve(M[at][:, at], M[at])
            M[at], M[:, at] = 0.0, 0.0
            state = state._replace(
                past=state.past + M, left=state.left + self._squares(state, prediction.a)
            )
        state = state._replace(
            products=self._nothing["products"],
            accepted=(state.accepted[0], 0, 0),
            recent=(),
            pending=(),
            load=load,
        )
        return state._replace(prediction=self._predict(state)) if state.prediction else state

    def _map(self, state: EstimatorState, a: np.ndarray) -> Any:
        """Return sparse B (e, p + 1): the equations times B are those in parameters near a (p).

        With x the share by which friction near rest is larger, dry friction d has the columns
        d (sigma + x sigma exp(-|v| / fading)).
        """
        from scipy.sparse import csr_array  # here, because scipy is slow to import

        B = self._B.copy()
        x = a[self._rest, None]
        dry = a[self._rubbing]
        B[self._fading, self._rubbing] = x
        B[self._fading, self._rest[:, None]] = dry
        B[self._fading, -1] = x * dry  # as the product x d is in both columns
        if state.load is None:
            B[:, self._load] = 0.0
        return csr_array(self._under_load(state, a)) @ csr_array(B)

    def _under_load(self, state: EstimatorState, a: np.ndarray) -> np.ndarray:
        """Return S (e, e): the equations times S are linear in load and gears near a (p).

        With s the share of a gear and l the load, the columns E of ``carried`` add s E l.
        """
        # a load that is unknown from the start cannot be told from an unknown last body
        known = state.load is not None and (self._alone or state.past.any())
        S = np.eye(len(self._B))
        shares = known * a[self._shares]
        load = known * a[self._load]
        S[self._carried] = 0.0
        S[self._carried, self._loaded] = shares
        S[self._carried, self._gears] = load
        S[self._carried, -1] = shares * load
        return S

    def _each(self, windows: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Return the equations (N, k) of each joint, of the columns that it has."""
        rows = np.array(windows)[:, :, self._order]
        return [rows[:, j, at] for j, at in enumerate(self._places)]

    def _prior(self, state: EstimatorState) -> PhysicalSet:
        """Return the physical parameters around the description and a load."""
        center = self._physical.center.copy()
        if state.load is not None:
            center[self._load] = state.load
        return replace(self._physical, center=center)

    def _sums(self, state: EstimatorState, noise: np.ndarray) -> np.ndarray:
        """Return the products (e, e) of the windows with the present load."""
        M = np.zeros_like(state.past)
        for at, one, size in zip(self._places, state.products, noise, strict=True):
            M[np.ix_(at, at)] += one / size**2
        return M

    def _equations(self, state: EstimatorState, noise: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return the products (p + 1, p + 1) of all equations, the last column being y."""
        B = self._map(state, a)
        return B.T @ (self._sums(state, noise) + state.past) @ B

    def _weights(self, state: EstimatorState, a: np.ndarray) -> np.ndarray:
        """Return w (e): the equations times w are the residuals at a (p)."""
        return self._map(state, a) @ np.append(-a, 1.0)

    def _squares(self, state: EstimatorState, a: np.ndarray) -> np.ndarray:
        """Return the sum (n) of the squared residuals of windows with the present load."""
        w = self._weights(state, a)
        found = [w[at] @ M @ w[at] for at, M in zip(self._places, state.products, strict=True)]
        return np.maximum(found, 0.0)

    def _noise(self, state: EstimatorState, a: np.ndarray, fitted: float) -> np.ndarray:
        """Return the noise (n) of windows at parameters (p), ``fitted`` of which they determine."""
        count = state.accepted[0]
        if not count:
            return np.ones(len(state.level))
        first, least = noise_levels(np.sqrt(state.level / count)[None])
        squares = state.left + self._squares(state, a) + OVERLAP * first**2
        free = max(count - fitted / len(first), 0.0) + OVERLAP
        return np.maximum(np.sqrt(squares / free), least)

    def _lasting(self, state: EstimatorState, a: np.ndarray, noise: np.ndarray) -> np.ndarray:
        """Return noise (n), of windows that are not independent, as if they were."""
        if len(state.recent) < _EVERY:
            return noise * np.sqrt(OVERLAP) * self._repeated
        w = self._weights(state, a)
        left = np.column_stack(
            [rows @ w[at] for rows, at in zip(self._each(state.recent), self._places, strict=True)]
        )
        return noise * self._repeated * lasting_noise(left) / (rms(left, 0) + TINY)

    def _predict(self, state: EstimatorState) -> _Prediction:
        """Return the estimate of least squares near the description, with its covariance."""
        center = self._prior(state).center
        before = state.prediction
        T = self._T
        a = center if before is None else before.a
        fitted = 0.0
        for _ in range(_ROUNDS if before is None else 1):
            M = self._equations(state, self._noise(state, a, fitted), a)
            X = _inverse(M, T)
            a = center + T @ (X @ (X.T @ (T.T @ (M @ np.append(-center, 1.0))[:-1])))
            a = np.maximum(a, self._least)
            fitted = len(a) - WEIGHT * np.sum(X**2)
        noise = self._noise(state, a, fitted)
        lasting = self._lasting(state, a, noise)
        root = T @ _inverse(self._equations(state, lasting, a), T)
        w = np.column_stack([np.append(-a, 1.0), np.pad(root, ((0, 1), (0, 0)))])
        return _Prediction(a, self._map(state, a) @ w, noise, lasting, state.accepted[0])

    def _agree(self, windows: Sequence[np.ndarray], prediction: _Prediction) -> bool:
        """Return whether windows are as predicted, within what is known of the parameters."""
        each = zip(self._each(windows), self._places, prediction.lasting, strict=True)
        both = np.concatenate([rows @ prediction.columns[at] / size for rows, at, size in each])
        r = both[:, 0]
        A = both[:, 1:]
        return bool(r @ np.linalg.solve(np.eye(len(r)) + A @ A.T, r) <= _LIMIT**2 * len(r))

    def estimate(self, state: EstimatorState, near: Estimate | None = None) -> Estimate:
        """Return what was learned: the physical least-squares estimate, as of ``identify``.

        Args:
            state: at any sample.
            near: an earlier estimate, which saves time.
        """
        self._own_state(state)
        a, noise = self._fitted(state, None if near is None else near.a, [])
        if self._wrist:  # as ``identify`` chooses it
            without = self._fitted(state, a, self._wrist)
            if np.mean((noise / without[1]) ** 2) > 1.0 - LEAST_GAIN:
                a, noise = without
        T, _ = self._prior(state).local(a)
        root = T @ _inverse(self._equations(state, self._lasting(state, a, noise), a), T)
        load = None
        if state.load is not None:
            value, gradient = of_load(self.robot, a[self._load])
            load = PayloadEstimate(value, np.linalg.norm(gradient @ root[self._load], axis=1))
        return Estimate(
            self._robot(state, a),
            load,
            self.names,
            a,
            np.linalg.norm(root, axis=1),
            noise,
            self._advice(state, load, root, noise),
        )

    def _fitted(
        self, state: EstimatorState, near: np.ndarray | None, without: list[int]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return parameters (p), others being near (p), and noise (n); some are as described."""
        physical = self._prior(state)
        kept = np.ones(len(self.names))
        kept[without] = 0.0
        a = physical.center if near is None else near
        noise = self._noise(state, a, 0.0) if state.prediction is None else state.prediction.noise
        for _ in range(_ROUNDS):
            A, b = _rows(self._equations(state, noise, a))
            fit = physical_fit(A * kept, b, physical, gamma=WEIGHT, near=near)
            a = near = np.maximum(fit, self._least)
            noise = self._noise(state, a, 0.0)
        a[without] = physical.center[without]
        return a, noise

    def _robot(self, state: EstimatorState, a: np.ndarray) -> Robot:
        """Return the robot with parameters (p) and the load."""
        found = self._weights(state, a)
        found[self._own] += found[self._loaded]
        robot = self.dynamics.robot(-found[: self.dynamics.size], self.robot)
        breakaway = robot.friction.breakaway.copy()
        breakaway[self._near] += a[self._rest]
        friction = replace(robot.friction, breakaway=breakaway)
        if self._wrist and (a[self._wrist] == self._physical.center[self._wrist]).all():
            friction = replace(friction, shafts=())
        return replace(robot, friction=friction, loads=())

    def _advice(
        self,
        state: EstimatorState,
        load: PayloadEstimate | None,
        root: np.ndarray,
        noise: np.ndarray,
    ) -> str:
        """Return which joint to shake, if that told more of the load than the noise hides."""
        robot = self.robot
        if not state.last or state.last[0] is state.last[1]:
            return f"no two samples in sequence yet: is their period {self._period:g} s, as stated?"
        if load is None or load.mass_known_to < _KNOWN * max(load.mass, 0.01 * robot.mass):
            return ""
        gains = np.zeros(robot.model.nv)
        for j in self._moving:
            step = _SHAKE * np.eye(len(gains))[j]
            q = pin.integrate(robot.model, robot.q0, step)
            Y = self.dynamics.regressor(q, 0.0 * step, -step * (2.0 * np.pi) ** 2)
            gains[j] = np.linalg.norm(Y[:, self._own] @ root[self._load] / noise[:, None])
        return f"not enough motion yet: shake {robot.joint_names[gains.argmax()]}"


def _inverse(M: np.ndarray, T: np.ndarray) -> np.ndarray:
    """Return X (p, p), T X X^T T^T the inverse of the products M (p + 1, p + 1) and of WEIGHT."""
    whole = T.T @ M[:-1, :-1] @ T
    rounding = len(T) * np.finfo(float).eps * np.diagonal(whole)
    whole.flat[:: len(T) + 1] += WEIGHT + rounding
    return np.linalg.inv(np.linalg.cholesky(whole)).T


def _rows(M: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return A and b with the products M = [A b]^T [A b]."""
    size = np.sqrt(np.diagonal(M)) + TINY
    values, vectors = np.linalg.eigh(M / size / size[:, None])
    rows = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T * size
    return rows[:, :-1], rows[:, -1]
