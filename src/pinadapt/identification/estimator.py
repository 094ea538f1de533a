"""Estimates of a robot and its load beside any program that moves it, one sample at a time.

The equations are those of ``identify``: the motion averaged over overlapping windows phi, with the
momentum Y_M a + p_0 integrated by parts,

    int phi N (tau - tau_0 - Y_0 a) dt = - int (phi N)' (Y_M a + p_0) dt,

N the projection onto what no constraint force changes, one for a chain. Every window that agrees
with what was learned adds its products W^T W to those of its joint, so that noise and estimate
follow from all motion as they do offline, whenever they are asked for. Joints have all coefficients
of ``Friction``, near those of the description.

A window that disagrees is put aside. If those after it agree again it was a push; if all of them
agree with another load, that is the load. A load is ten parameters of its own in the axes of the
last body; products of windows with an earlier one are kept with it eliminated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from .._checks import flag, instance, positive
from ..description.floating_base import BASE_JOINTS
from ..exceptions import ImplausibleError, InputError, MeasurementError
from ..information.information import rms
from ..information.measured_motion import FEWEST, LENGTH, OVERLAP, bump
from ..information.payload import USUAL as EXPECTED
from ..information.payload import PayloadEstimate, of_load
from ..models.bodies import chosen_bodies
from ..models.joint_effects import KINDS, USUAL
from ..models.physical_fit import PhysicalSet, physical_fit, physical_set
from ..models.regressor import LABELS, PER_BODY, random_states
from ..records import Measurement
from ..robot.changes import Payload
from ..robot.robot import Robot
from ..tuning.unknowns import Unknown, nominal_dynamics
from .fits import FREE, LIGHT, WEIGHT, lasting_noise

_SMOOTH = 0.05  # [s] before and after a sample
FADING = 0.1  # [rad/s or m/s] of friction near rest
# Windows: of a load before it is believed, longer than a push of half a second; of a comparison.
_LOADED, _EVERY, _RECENT = 12, 8, 150
_LIMIT = 3.0  # deviations
_ROUNDS = 4
_DRY = "coulomb", "gear_friction", "asymmetry"
_LEVELS = 0.05, 1e-4  # shares of a torque: its noise at first, and the least


class Window(NamedTuple):
    """An average of the equations: W a = y.

    Attributes:
        t: time of its middle [s].
        W: (n, c) regressor.
        y: (n) torque without its known part [N m or N].
        tau: (n) torque [N m or N].
    """

    t: float
    W: np.ndarray
    y: np.ndarray
    tau: np.ndarray


class _Rows(NamedTuple):
    """The equations at a sample; columns are those of the parameters, tau less y, tau and |v|.

    Attributes:
        t: time [s].
        before: of the sample before [s].
        N: (n, n) projections at the sample before, and at this one.
        M: (n, c + 3) momentum.
        F: (n, c + 3) all else.
    """

    t: float
    before: float
    N: tuple[np.ndarray, np.ndarray] | None
    M: np.ndarray
    F: np.ndarray


class _Belief(NamedTuple):
    """What new windows are compared with.

    Attributes:
        a: (p) parameters.
        left: w (c + 1): [W y] w is the residual of a window.
        slopes: (c, p) L of the covariance L L^T of the first c of these.
        noise: (n) of the torque of a window [N m or N].
        lasting: (n) the same, as if windows were independent.
        count: of windows that are in it.
    """

    a: np.ndarray
    left: np.ndarray
    slopes: np.ndarray
    noise: np.ndarray
    lasting: np.ndarray
    count: int


class EstimatorState(NamedTuple):
    """All that an ``Estimator`` remembers; its arrays are never written.

    Attributes:
        samples: the last ones, as many as positions are smoothed over.
        begin: of the oldest open window [s].
        sums: (3, n, c + 3) over the open windows, the oldest first.
        last: equations at the last sample, or the middle one; None: windows begin anew.
        products: of the windows with the present load, one for each joint, of its columns.
        past: (c + 1, c + 1) of all windows with other loads, in units of their noise.
        level: (n) sum of the squared torques of accepted windows.
        left: (n) sum of the squared residuals of windows with other loads.
        counts: windows accepted, those of them with the present load, and refused since the last
            one was accepted.
        recent: the last accepted windows.
        aside: windows that disagree.
        belief: what windows are compared with; None at first.
        load: (10) centre of what may be carried; None: surely nothing.
    """

    samples: tuple[Measurement, ...]
    begin: float
    sums: np.ndarray
    last: _Rows | None
    products: tuple[np.ndarray, ...]
    past: np.ndarray
    level: np.ndarray
    left: np.ndarray
    counts: tuple[int, int, int]
    recent: tuple[Window, ...]
    aside: tuple[Window, ...]
    belief: _Belief | None
    load: np.ndarray | None

    @property
    def t(self) -> float:
        """Time of the last sample [s]."""
        return self.samples[-1].t


@dataclass(frozen=True, eq=False)
class Estimate:
    """What was learned until a sample.

    Attributes:
        robot: with all that was learned, the load included.
        load: on the last body, in the axes of the task frame; None: surely nothing.
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

        What is welded to a body in it loses its mass, as the body contains it.

        Raises:
            InputError: the model lacks a joint.
        """
        import mujoco  # here, because it is an extra

        own = mujoco.MjData(model)
        own.qpos[:] = model.qpos0
        mujoco.mj_kinematics(model, own)
        write_bodies(self.robot, model, own)

    def __str__(self) -> str:
        """Return the load and the advice."""
        load, words = self.load, "no load"
        if load is not None:
            centre = ", ".join(
                f"{1e3 * c:.0f} +- {1e3 * d:.0f}"
                for c, d in zip(load.com, load.com_known_to, strict=True)
            )
            words = f"load {load.mass:.3f} +- {load.mass_known_to:.2g} kg at ({centre}) mm"
        noise = ", ".join(f"{part:.2g}" for part in self.noise)
        return f"{words}; torques to {noise} N m{self.advice and f'; {self.advice}'}"


class Estimator:
    """Bodies, load and friction of a robot from q, v and tau, whatever moves it.

    ``init`` and ``step`` are pure. Windows in which nothing moves are not read, as friction then
    hides the torque; after a gap between samples windows begin anew.

    M. Shinbrot, *On the analysis of linear and nonlinear systems*, Trans. ASME 79 (1957) 547-552.

    Attributes:
        robot: as described.
        names: of the parameters (p).
        length: of a window [s].
    """

    def __init__(
        self,
        robot: Robot,
        unknown: Unknown | str | Sequence[str] | None = None,
        *,
        period: float = 1e-3,
        held: bool = True,
        smooth: bool = False,
    ) -> None:
        """Choose what is estimated.

        Args:
            robot: as described, a chain, a tree or a robot with constraints.
            unknown: "bodies" (the default) or "payload", as ``Unknown`` has it. With either the
                load is unknown, and friction unless ``Unknown`` states it.
            period: typical time between samples [s].
            held: whether tau is the mean since the last sample; else it is that of the instant.
            smooth: whether positions are smoothed over 0.1 s, and velocities are theirs: for noisy
                or missing v. Estimates are then 0.05 s late.

        Raises:
            InputError: words that cannot be used, or parameters that are not of bodies.
        """
        self.robot = instance(robot, Robot, "robot").undrawn()
        self.length = max(LENGTH, FEWEST * positive(period, "period"))
        self._held, given = flag(held, "held"), Unknown.of(unknown)
        if not isinstance(unknown, Unknown):
            given = replace(given, friction=None, armature=None)
        carrier, free = robot.carriers[0], chosen_bodies(robot, given.bodies)
        payload_alone = free == [carrier] and given.bodies == "payload"
        joints = [name for name in robot.joint_names if name not in BASE_JOINTS]
        names = [robot.joint_names[body] for body in sorted({*free, carrier})]
        chosen = replace(given.with_joints(), bodies=names, tool=False)
        near = list[int]()
        if given.friction is None:
            words = [f"{name}.{kind}" for name in joints for kind in KINDS]
            shafts = [part.name(robot.joint_names) for part in robot.friction.shafts]
            words += [f"{name}.{kind}" for name in shafts for kind in USUAL]
            chosen = replace(chosen, friction=False, armature=False, effects=words)
            near = [robot.joint_names.index(name) for name in joints]
            friction = replace(robot.friction, breakaway=1.0, fading=FADING).of(robot.model)
            self.robot = replace(self.robot, friction=friction)
        self._near = near
        self.dynamics = dynamics = nominal_dynamics(self.robot, chosen, ())
        own, size = physical_set(dynamics, self.robot), dynamics.inertial.size
        first = PER_BODY * names.index(robot.joint_names[carrier])
        self._own = slice(first, first + PER_BODY)
        at = dynamics.names.index
        self._dry = np.array(
            [[at(f"{robot.joint_names[j]}.{kind}") for kind in _DRY] for j in near], dtype=int
        ).reshape(-1, len(_DRY))
        self._columns = dynamics.size + self._dry.size
        # parameters: bodies, the load, coefficients of the joints, their friction near rest
        known = range(*self._own.indices(size)) if payload_alone else ()
        kept = [i for i in range(dynamics.size) if i not in known]
        first = size - len(known)
        self._load = slice(first, first + PER_BODY)
        labels = [f"load.{label}" for label in LABELS]
        listed = [dynamics.names[i] for i in kept]
        breakaways = [f"{robot.joint_names[j]}.breakaway" for j in near]
        self.names = (*listed[:first], *labels, *listed[first:], *breakaways)
        p = len(self.names)
        # [W y] B are the equations in the parameters, those of the load aside
        self._B = np.zeros((self._columns + 1, p + 1))
        rest = np.delete(np.arange(p - len(near)), self._load)
        self._B[kept, rest] = 1.0
        self._B[-1, -1] = 1.0
        if payload_alone:
            self._B[self._own, -1] = -dynamics.initial[self._own]
        ball = pin.Inertia.FromSphere(EXPECTED * robot.mass, EXPECTED * robot.reach)
        placement = robot.model.frames[robot.frame_id].placement
        self._usual = placement.act(ball).toDynamicParameters()
        center = np.insert(own.center[kept], first, self._usual)
        # the share of a gear may be typical; any dry or viscous friction is likely
        shares = [name.endswith(".gear_friction") for name in dynamics.names[size:]]
        weights = np.where(shares, dynamics.initial[size:] / dynamics.typical[size:], LIGHT)
        weights = weights[: len(weights) - len(own.scales)]
        bodies = first // PER_BODY
        self._physical = PhysicalSet(
            bodies + 1,
            np.append(center, np.zeros(len(near))),
            weights,
            np.append(np.ones(bodies), FREE),
            np.append(own.scales, np.ones(len(near))),
        )
        # which columns the equation of a joint has
        found = np.full((robot.model.nv, self._columns + 1), bool(robot.constraints))
        found[:, -1] = True
        for q, v, _ in random_states(robot.model, 3):
            rows = self._rows(Measurement(0.0, q, v, tau=0.0 * v), None)
            found |= (rows.M[:, :-2] != 0.0) | (rows.F[:, :-2] != 0.0)
        self._places = [np.flatnonzero(one) for one in found]
        moving = np.isin(robot.joint_names, joints)
        count = max(round(_SMOOTH / period), 2) if flag(smooth, "smooth") else 0
        self._count = 2 * count + 1
        self._still = np.where(moving, robot.friction.threshold, np.inf)

    def init(self, measurement: Measurement, payload: Payload | None = None) -> EstimatorState:
        """Return the state at the first sample.

        Args:
            measurement: with q, v and tau.
            payload: what is carried, see ``announce``; None: unknown.

        Raises:
            MeasurementError: a signal is missing, of the wrong size, or not finite.
            RobotError: an impossible load.
        """
        sums = np.zeros((OVERLAP, self.robot.model.nv, self._columns + 3))
        first = self._checked(measurement)
        nothing = EstimatorState((), first.t, sums, None, load=self._usual, **self._nothing)
        state = self._with(nothing, first)
        return state if payload is None else self.announce(state, payload)

    @property
    def _nothing(self) -> dict[str, Any]:
        """What a state has learned at first."""
        n, c = self.robot.model.nv, self._columns + 1
        return {
            "products": tuple(np.zeros((len(at), len(at))) for at in self._places),
            "past": np.zeros((c, c)),
            "level": np.zeros(n),
            "left": np.zeros(n),
            "counts": (0, 0, 0),
            "recent": (),
            "aside": (),
            "belief": None,
        }

    def announce(self, state: EstimatorState, payload: Payload | None) -> EstimatorState:
        """Return the state after another load was taken up, as a tool changer tells.

        Args:
            state: before.
            payload: that is carried now, which is then estimated from there, in the axes of the
                task frame; without mass: surely nothing; None: it is unknown.

        Raises:
            RobotError: an impossible load.
        """
        load: np.ndarray | None = self._usual
        if payload is not None:
            placement = self.robot.model.frames[self.robot.frame_id].placement
            load = placement.act(payload.spatial_inertia()).toDynamicParameters()
            load = load if payload.present else None
        return self._changed(state, load)

    def step(self, state: EstimatorState, measurement: Measurement) -> EstimatorState:
        """Return the state after a sample.

        Raises:
            MeasurementError: a signal is missing, of the wrong size, or not finite.
            ImplausibleError: the time is not after the last one's.
        """
        now = self._checked(measurement)
        if now.t <= state.t:
            raise ImplausibleError("t", now.t, f"is not after the last sample's, {state.t:g} s")
        if now.t - state.t > 2.0 * self.length / FEWEST:
            state = state._replace(samples=(), last=None)
        return self._with(state, now)

    def _with(self, state: EstimatorState, sample: Measurement) -> EstimatorState:
        """Return the state after a sample that was checked."""
        samples, last = (*state.samples, sample)[-self._count :], state.last
        state = state._replace(samples=samples)
        if len(samples) < self._count:
            return state
        now = self._rows(samples[0] if self._count == 1 else self._smoothed(samples), last)
        if last is None:
            return state._replace(begin=now.t, sums=0.0 * state.sums, last=now)
        elapsed = now.t - last.t
        # the last sample is complete, as the time until the next one is known
        middles = state.begin + self.length * (0.5 + np.arange(OVERLAP) / OVERLAP)
        phi, rate = bump(last.t - middles, self.length)
        share = 0.5 * (now.t - last.before)
        M, F = last.M, share * last.F
        if now.N is not None and last.N is not None:
            speed = F[:, -1]
            F = last.N[1] @ F - 0.5 * (now.N[1] - last.N[0]) @ M
            M, F[:, -1] = last.N[1] @ M, speed
        if self._held:
            F[:, -2] = 0.0
        sums = state.sums + phi[:, None, None] * F - (share * rate)[:, None, None] * M
        if self._held:
            between = bump(0.5 * (last.t + now.t) - middles, self.length)[0] * elapsed
            tau = now.F[:, -2] if now.N is None else 0.5 * (now.N[0] + now.N[1]) @ now.F[:, -2]
            sums[:, :, -2] += between[:, None] * tau
        state = state._replace(sums=sums, last=now)
        if last.t < state.begin + self.length:
            return state
        W, known, tau, speed = np.split(sums[0], [self._columns, -2, -1], axis=1)
        found = Window(float(middles[0]), W, (tau - known)[:, 0], tau[:, 0])
        state = state._replace(
            begin=state.begin + self.length / OVERLAP,
            sums=np.concatenate([sums[1:], 0.0 * sums[:1]]),
        )
        moved = (speed[:, 0] > self._still).any()
        return self._judged(state, found) if moved else state

    def _checked(self, measurement: Measurement) -> Measurement:
        """Return a measurement as arrays of finite floats."""
        instance(measurement, Measurement, "measurement")
        t, q, v, tau = measurement.t, measurement.q, measurement.v, measurement.tau
        model = self.robot.model
        v = np.zeros(model.nv) if v is None and self._count > 1 else v
        found = []
        for name, value, size in (("q", q, model.nq), ("v", v, model.nv), ("tau", tau, model.nv)):
            if value is None or np.shape(value) != (size,) or not np.isfinite(value).all():
                raise MeasurementError(name, value, f"must be {size} finite numbers")
            found.append(np.array(value, dtype=float))
        if not np.isfinite(t):
            raise MeasurementError("t", t, "must be a finite number")
        return Measurement(float(t), found[0], found[1], tau=found[2])

    def _smoothed(self, samples: Sequence[Measurement]) -> Measurement:
        """Return the middle sample, on cubics through the positions around it."""
        middle, model = samples[self._count // 2], self.robot.model
        t = np.array([one.t for one in samples]) - middle.t
        if model.nq == model.nv:
            moved = np.array([one.q for one in samples]) - middle.q
        else:
            moved = np.array([pin.difference(model, middle.q, one.q) for one in samples])
        powers = (t[:, None] / t[-1]) ** np.arange(4)
        value, slope = np.linalg.lstsq(powers, moved, rcond=None)[0][:2]
        return middle._replace(q=pin.integrate(model, middle.q, value), v=slope / t[-1])

    def _rows(self, measurement: Measurement, last: _Rows | None) -> _Rows:
        """Return the equations at a sample."""
        robot, n = self.robot, self.robot.model.nv
        t, q, v, tau = measurement.t, measurement.q, measurement.v, measurement.tau
        Y_M, Y_0, p_0, tau_0 = self.dynamics.momentum(q, v)
        M, F = np.zeros((2, n, self._columns + 3))
        size = self.dynamics.size
        M[:, :size], M[:, -3], F[:, :size], F[:, -3] = Y_M, p_0, Y_0, tau_0
        F[:, -2], F[:, -1] = tau, np.abs(v)
        near = np.array(self._near, dtype=int)
        fading = np.exp(-np.abs(v[near]) / FADING)[:, None]
        columns = np.arange(size, self._columns).reshape(self._dry.shape)
        F[near[:, None], columns] = fading * Y_0[near[:, None], self._dry]
        N = None
        if robot.constraints:
            free = robot.constrained.free(q, v)
            N = (free if last is None or last.N is None else last.N[1], free)
        return _Rows(t, t if last is None else last.t, N, M, F)

    def _judged(self, state: EstimatorState, found: Window) -> EstimatorState:
        """Return the state after a window, accepted or put aside."""
        belief = state.belief
        if belief is None or (not state.aside and self._agree([found], belief)):
            return self._accepted(state, [found])
        total, present, refused = state.counts
        aside = (*state.aside, found)
        state = state._replace(aside=aside[-_LOADED:], counts=(total, present, refused + 1))
        latest = list(aside[-OVERLAP:])
        if len(aside) > OVERLAP and self._agree(latest, belief):  # it was a push
            return self._accepted(state._replace(aside=()), latest)
        later = aside[OVERLAP:]
        if len(aside) >= _LOADED:
            other = self._changed(state, self._usual)
            if other.belief is not None and self._agree(later, other.belief):
                return self._accepted(other, later)
        if refused >= total:  # what was learned is contradicted for longer than it was supported
            nothing = self._nothing
            return self._accepted(state._replace(**nothing), later)
        return state

    def _accepted(self, state: EstimatorState, windows: Sequence[Window]) -> EstimatorState:
        """Return the state that learned from windows."""
        products, level = state.products, state.level
        for one in windows:
            rows = np.column_stack([one.W, one.y])
            each = [row[at] for row, at in zip(rows, self._places, strict=True)]
            products = tuple(
                old + np.outer(row, row) for old, row in zip(products, each, strict=True)
            )
            level = level + one.tau**2
        total, present, _ = state.counts
        state = state._replace(
            products=products,
            level=level,
            counts=(total + len(windows), present + len(windows), 0),
            recent=(*state.recent, *windows)[-_RECENT:],
        )
        learned = state.counts[0] - (0 if state.belief is None else state.belief.count)
        if learned < max(_EVERY, state.counts[0] // _EVERY):
            return state
        return state._replace(belief=self._believed(state))

    def _changed(self, state: EstimatorState, load: np.ndarray | None) -> EstimatorState:
        """Return the state with another load, of which nothing but its prior is known."""
        past, left = state.past, state.left
        if state.counts[1]:
            belief = state.belief or self._believed(state)
            M, at = self._products(state, belief.lasting), self._own
            if state.load is not None:
                T, _ = self._physical.local(self._physical.center)
                known = np.linalg.inv(T[self._load, self._load])
                known = np.column_stack([known, known @ state.load])
                inner, cross = M[at, at] + known[:, :-1].T @ known[:, :-1], M[at].copy()
                cross[:, -1] += known[:, :-1].T @ known[:, -1]
                M[-1, -1] += known[:, -1] @ known[:, -1]
                M -= cross.T @ np.linalg.solve(inner, cross)
            past = past + M
            left = left + self._squares(state, belief.a)
        state = state._replace(
            products=self._nothing["products"],
            past=past,
            left=left,
            counts=(state.counts[0], 0, 0),
            recent=(),
            aside=(),
            load=load,
        )
        return state._replace(belief=self._believed(state)) if state.belief else state

    def _map(self, load: np.ndarray | None, a: np.ndarray | None = None) -> np.ndarray:
        """Return B: [W y] B are the equations in the parameters, linearised at a (p).

        With x the share by which friction near rest is larger, dry friction d has the columns
        d (sigma + x sigma exp(-|v| / fading)).
        """
        B, near = self._B.copy(), len(self._near)
        if load is not None:
            B[self._own, self._load] = np.eye(PER_BODY)
        if not near:
            return B
        a = self._physical.center if a is None else a
        first, last = self._columns - self._dry.size, len(self.names)
        rows = first + np.arange(self._dry.size).reshape(self._dry.shape)
        x, dry = a[last - near : last, None], self._B[self._dry] @ np.append(a, 0.0)
        B[rows] += x[:, :, None] * self._B[self._dry]
        B[rows, last - near + np.arange(near)[:, None]] += dry
        B[rows, -1] += x * dry  # as the product x d is in both columns
        return B

    def _prior(self, state: EstimatorState) -> PhysicalSet:
        """Return the physical parameters around the description and a load."""
        center = self._physical.center.copy()
        if state.load is not None:
            center[self._load] = state.load
        return replace(self._physical, center=center)

    def _products(self, state: EstimatorState, noise: np.ndarray) -> np.ndarray:
        """Return the products (c + 1, c + 1) of the windows with the present load."""
        M = np.zeros_like(state.past)
        for at, one, size in zip(self._places, state.products, noise, strict=True):
            M[np.ix_(at, at)] += one / size**2
        return M

    def _equations(
        self, state: EstimatorState, noise: np.ndarray, a: np.ndarray | None = None
    ) -> np.ndarray:
        """Return the products (p + 1, p + 1) of all equations, the last column being y."""
        B, B_past = self._map(state.load, a), self._map(None, a)
        M = B.T @ self._products(state, noise) @ B
        return M + B_past.T @ state.past @ B_past if state.past.any() else M

    def _left(self, state: EstimatorState, a: np.ndarray) -> np.ndarray:
        """Return w (c + 1): [W y] w are the residuals of windows with the present load."""
        return self._map(state.load, a) @ np.append(-a, 1.0)

    def _squares(self, state: EstimatorState, a: np.ndarray) -> np.ndarray:
        """Return the sum (n) of the squared residuals of windows with the present load."""
        w = self._left(state, a)
        each = zip(self._places, state.products, strict=True)
        return np.maximum([w[at] @ one @ w[at] for at, one in each], 0.0)

    def _noise(self, state: EstimatorState, a: np.ndarray, fitted: float) -> np.ndarray:
        """Return the noise (n) of windows at parameters (p), ``fitted`` of which they determine."""
        count = max(state.counts[0], 1)
        first, least = np.outer(_LEVELS, np.sqrt(state.level / count) + np.finfo(float).tiny)
        squares = state.left + self._squares(state, a) + OVERLAP * first**2
        free = max(count - fitted / len(first), 0.0) + OVERLAP
        return np.maximum(np.sqrt(squares / free), least)

    def _lasting(self, state: EstimatorState, a: np.ndarray) -> np.ndarray:
        """Return the factors (n) of the noise of windows that are not independent."""
        if len(state.recent) < _EVERY:
            return np.full(len(state.level), np.sqrt(OVERLAP))
        w = self._left(state, a)
        left = np.array([one.W @ w[:-1] + one.y for one in state.recent])
        return lasting_noise(left) / (rms(left, 0) + np.finfo(float).tiny)

    def _believed(self, state: EstimatorState) -> _Belief:
        """Return the estimate of least squares near the description, with its covariance."""
        physical, before = self._prior(state), state.belief
        center = physical.center
        T, _ = physical.local(center)
        a, fitted = center if before is None else before.a, 0.0
        for _ in range(_ROUNDS if before is None else 1):
            M = self._equations(state, self._noise(state, a, fitted), a)
            inverse = _inverse(M[:-1, :-1], T)
            a = center + inverse @ (inverse.T @ (M[:-1, -1] - M[:-1, :-1] @ center))
            a = self._bounded(a)
            fitted = len(a) - float(np.sum(np.linalg.solve(T, inverse) ** 2))
        noise = self._noise(state, a, fitted)
        lasting, B = noise * self._lasting(state, a), self._map(state.load, a)
        root = _inverse(self._equations(state, lasting, a)[:-1, :-1], T)
        slopes = B[:-1, :-1] @ root
        return _Belief(a, self._left(state, a), slopes, noise, lasting, state.counts[0])

    def _agree(self, windows: Sequence[Window], belief: _Belief) -> bool:
        """Return whether windows are what was believed, within what was known."""
        W = np.concatenate([one.W / belief.lasting[:, None] for one in windows])
        r = W @ belief.left[:-1] + np.concatenate([one.y / belief.lasting for one in windows])
        A = W @ belief.slopes
        return bool(r @ np.linalg.solve(np.eye(len(r)) + A @ A.T, r) <= _LIMIT**2 * len(r))

    def estimate(self, state: EstimatorState, near: Estimate | None = None) -> Estimate:
        """Return what was learned: the physical least-squares estimate, as of ``identify``.

        Args:
            state: at any sample.
            near: an earlier estimate, which saves time.
        """
        physical, a = self._prior(state), None if near is None else near.a
        if a is None and state.belief is not None:
            noise = state.belief.noise
        else:
            noise = self._noise(state, physical.center if a is None else a, 0.0)
        at = physical.center if a is None else a
        for _ in range(_ROUNDS):
            rows = _rows(self._equations(state, noise, at))
            a = physical_fit(*rows, physical, gamma=WEIGHT, near=a)
            at = a = self._bounded(a)
            noise = self._noise(state, a, 0.0)
        T, _ = physical.local(a)
        M = self._equations(state, noise * self._lasting(state, a), a)
        root = _inverse(M[:-1, :-1], T)
        load = None
        if state.load is not None:
            value, gradient = of_load(self.robot, a[self._load])
            deviation = np.linalg.norm(gradient @ root[self._load], axis=1)
            load = PayloadEstimate.of(value, deviation)
        deviations = np.linalg.norm(root, axis=1)
        return Estimate(
            self._robot(state, a),
            load,
            self.names,
            a,
            deviations,
            noise,
            self._advice(state, root, noise),
        )

    def _robot(self, state: EstimatorState, a: np.ndarray) -> Robot:
        """Return the robot with parameters (p) and the load."""
        robot = self.dynamics.robot(-self._left(state, a)[: self.dynamics.size], self.robot)
        breakaway = robot.friction.breakaway.copy()
        breakaway[self._near] += a[len(a) - len(self._near) :]
        friction = replace(robot.friction, breakaway=breakaway)
        return replace(robot, friction=friction, loads=())

    def _bounded(self, a: np.ndarray) -> np.ndarray:
        """Return parameters (p) with friction near rest that is not negative."""
        first = len(a) - len(self._near)
        return np.append(a[:first], np.maximum(a[first:], -1.0))

    def _advice(self, state: EstimatorState, root: np.ndarray, noise: np.ndarray) -> str:
        """Return which joint to move, if that told more of the load than a window's noise hides."""
        return ""


def _inverse(H: np.ndarray, T: np.ndarray) -> np.ndarray:
    """Return L (p, p) with L L^T the inverse of H + T^-T T^-1."""
    return T @ np.linalg.inv(np.linalg.cholesky(T.T @ H @ T + WEIGHT * np.eye(len(T)))).T


def _rows(M: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return A and b with the products M = [A b]^T [A b]."""
    size = np.sqrt(np.diagonal(M)) + np.finfo(float).tiny
    values, vectors = np.linalg.eigh(M / size / size[:, None])
    rows = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T * size
    return rows[:, :-1], rows[:, -1]
