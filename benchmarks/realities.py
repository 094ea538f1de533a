"""The default and its rivals in realities that no proof knows.

``make realities.table`` runs the sweep ``realities.toml``: the case of the zoo (tool, load,
inertias and friction unknown, a circle) where encoders, motors, gears, friction or the world
around the arm are not those of the model.

Contenders: no adaptation of the dynamics ("none"), "natural", the library's default, and momentum
observers, which take the disturbance torque that they see off the torque of "none". All learn the
kinematics as the default does. What a reality adds is unknown to the controller, but for declared
encoders, the camera, the period, and rotor inertias where joints give way.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import cache, partial
from typing import Any

import numpy as np
import pinocchio as pin

import pinadapt as pa
from pinadapt.controller import ControllerState
from pinadapt.description.chain import angles_from_configuration, effort_limits, is_slide
from pinadapt.plants.elastic_plant import ElasticPlant
from pinadapt.plants.pinocchio_plant import PinocchioPlant
from pinadapt.plants.plant import SimulatedPlant
from pinadapt.records import Desired, Measurement
from pinadapt.zoo.experiment import zoo_case

from .shared import COUNT, Row, grouped, markdown, quiet, spread

DURATION = 6.0  # [s] of a run: half of it ends with the push, twice costs twice
PUSHED = 0.5  # [s] from half of the run on
BAND = 1e-3  # [m]; back is who errs by less than this above the largest error of 1 s to the push
AXES = "+x", "-y", "-z", "-x", "+y", "+z"  # of a push, by the seed
ROTOR = 0.5, 1e-3  # of the inertia that each joint moves, and least, of the largest of these
LEVER = 0.1  # [m] at which a slide has the play and the stiffness of a joint that turns
GEAR = 200.0  # periods of the ripple in a turn: a harmonic drive of 1:100 has two a motor turn
WARM = 3.0, 8.0  # friction falls to a third in 8 s
FADING = 0.05  # [rad/s or m/s] of the Stribeck effect


@dataclass(frozen=True)
class Reality:
    """What is not as in the model.

    Attributes:
        sensors: of the robot.
        declared: whether the controller knows the sensors.
        dt: period [s].
        duration: of the run [s].
        late: delay of the motors [s].
        stiffness: of the joints [N m/rad].
        play: of the gears, all of it [rad].
        damping: of the springs, as a share of the critical one of the rotors.
        ripple: amplitude of the motors' torque, of the effort limits.
        coulomb: factor on the dry friction.
        breakaway: dry friction near rest as a share of that at speed; for rigid joints.
        warms: whether friction falls during the run.
        torque_off: offset of the measured torque, of the effort limits; None: it is not measured.
        push: force on the tool in the middle of the run [N].
    """

    sensors: pa.Sensors = field(default_factory=pa.Sensors)
    declared: bool = True
    dt: float = 1e-3
    duration: float = DURATION
    late: float = 0.0
    stiffness: float = math.inf
    play: float = 0.0
    damping: float = 0.0
    ripple: float = 0.0
    coulomb: float = 1.0
    breakaway: float = 1.0
    warms: bool = False
    torque_off: float | None = None
    push: float = 0.0


REALITIES = {
    "perfect": Reality(),
    **{
        f"{bits} bit{' declared' * declared}": Reality(pa.Sensors(encoder=count), declared)
        for bits, count in sorted(COUNT.items(), reverse=True)
        for declared in (True, False)
    },
    **{f"motors {ms} ms late": Reality(late=1e-3 * ms) for ms in (2, 5, 10, 12, 15)},
    **{f"joints {k} kN m/rad": Reality(stiffness=1e3 * k) for k in (20, 5, 2)},
    # a planetary gear has 1 mrad, a harmonic drive a fifth of it
    "backlash": Reality(stiffness=2e4, play=5e-4, damping=0.1),
    "ripple": Reality(ripple=0.01),
    "dry friction": Reality(coulomb=2.0, breakaway=1.5),
    "warming up": Reality(warms=True, duration=8.0),
    "torque sensor off": Reality(torque_off=0.01),
    "push": Reality(push=40.0),
    "noisy frames": Reality(pa.Sensors(pa.Camera(rate=30.0, delay=0.06), noise={"x": 1e-3})),
    "frames lost": Reality(pa.Sensors(pa.Camera(rate=30.0, delay=0.06, dropout=0.3))),
    "500 Hz": Reality(dt=2e-3),
    "250 Hz": Reality(dt=4e-3),
    "all of it": Reality(
        pa.Sensors(pa.Camera(rate=30.0, delay=0.06, dropout=0.1), encoder=COUNT[17]),
        late=2e-3,
        stiffness=2e4,
        play=2e-4,
        damping=0.1,
        ripple=0.005,
        coulomb=1.5,
        warms=True,
        torque_off=0.005,
        push=20.0,
    ),
}


# --- the arm ---


def levers(robot: pa.Robot) -> np.ndarray:
    """Return m per rad (n) of what is stated in rad: LEVER of a slide, 1 of a joint that turns."""
    return np.array([LEVER if is_slide(joint) else 1.0 for joint in robot.model.joints[1:]])


class Unmodelled(SimulatedPlant):
    """What the description of an arm does not have: ripple, pushes, and torque sensors that err.

    Ripple and push are constant within a period.
    """

    def __init__(self, robot: pa.Robot, *, case: Reality, seed: int, axis: str, **own: Any) -> None:
        """Take a reality, the seed of the ripple's phases, and the axis of the push."""
        self._case = case
        self._efforts = effort_limits(robot.model)
        self._given = np.zeros(robot.model.nv)
        random = np.random.default_rng(seed)
        self._phase = random.uniform(0.0, 2.0 * math.pi, robot.model.nv)
        self._force = np.zeros(3)
        self._force["xyz".index(axis[1])] = math.copysign(case.push, float(f"{axis[0]}1"))
        self._data_of_push = robot.model.createData()
        super().__init__(robot, **own)

    def measure(self) -> Measurement:
        """Return what ideal sensors measure, and the torque with its offset."""
        off, found = self._case.torque_off, super().measure()  # type: ignore[safe-super]
        return found if off is None else found._replace(tau=self._given + off * self._efforts)

    def rippled(self, tau: np.ndarray, q: np.ndarray) -> np.ndarray:
        """Return a torque of the motors (n) with the ripple at their configuration q (nq)."""
        self._given = tau
        if not self._case.ripple:
            return tau
        angles = GEAR * angles_from_configuration(self.robot.model, q) + self._phase
        return tau + self._case.ripple * self._efforts * np.sin(angles)

    def pushed(self, q: np.ndarray) -> np.ndarray | float:
        """Return J^T F (n) of the push now, at the links' configuration q (nq) [N m or N]."""
        since = self._t - 0.5 * self._case.duration
        if not self._case.push or not -1e-9 < since < PUSHED - 1e-9:
            return 0.0
        robot = self.robot
        axes = pin.LOCAL_WORLD_ALIGNED
        at = robot.model, self._data_of_push, q, robot.frame_id, axes
        return np.asarray(self._force @ pin.computeFrameJacobian(*at)[:3])


class RigidArm(Unmodelled, PinocchioPlant):
    """A rigid arm."""

    def hold(self, tau: np.ndarray, dt: float) -> None:
        """Move for dt [s] under a torque tau (n) of the motors and what comes besides."""
        super().hold(self.rippled(tau, self._q) + self.pushed(self._q), dt)


class ElasticArm(Unmodelled, ElasticPlant):
    """An arm whose springs have a play: none of their torque within it, K (|d| - play / 2) beyond.

    The implicit step takes the secant of this torque between the deflections at start and end,
    the end as the velocities of the stage before predict it.
    """

    def spring(self, d: np.ndarray) -> np.ndarray:
        """Return the torque (n) of the springs at a deflection d (n) [N m or N]."""
        half = self._half
        return np.asarray(self._stiffness * (d - np.clip(d, -half, half)))

    def reset(self) -> None:
        """Return home at rest, with the springs loaded by gravity."""
        super().reset()
        self._stiffness, self._half = self._K, 0.5 * self._case.play * levers(self.robot)
        self._d = self._d + self._half * np.sign(self._d)
        self._read()

    def hold(self, tau: np.ndarray, dt: float) -> None:
        """Move for dt [s] under a torque tau (n) of the motors and what comes besides."""
        super().hold(self.rippled(tau, self._q), dt)

    def _means(
        self, q: np.ndarray, velocities: np.ndarray, tau: np.ndarray, h: float
    ) -> np.ndarray:
        """Return the mean velocities (2, n) of links and motors over h [s] from the current state.

        The push is added to the torque of the springs, which acts on both sides, and to that of
        the motors, so that it is left on the links alone.
        """
        v, w = velocities
        d = self._d
        way = h * (w - v)
        push = self.pushed(q)
        way = np.where(np.abs(way) < 1e-9, 1e-9, way)
        pull = self.spring(d)
        self._K = np.maximum((self.spring(d + way) - pull) / way, 1e-6)
        self._d = (pull + push) / self._K
        means = super()._means(q, velocities, tau + push, h)
        self._d = d
        return means


# --- contenders ---


class Observed(pa.Controller):
    """A controller less the disturbance torque r of a momentum observer, dr/dt = k (d - r).

    r = k (M v - p), dp/dt = tau + C^T v - g + r, all of the nominal robot: A. De Luca, R. Mattone,
    *Actuator failure detection and isolation using generalized momenta*, ICRA 2003. p is kept here,
    so that one object serves one run.

    Attributes:
        k: rate of the observer [1/s].
        p: (n) predicted momentum; None before the first sample.
    """

    k: float
    p: np.ndarray | None = None

    @classmethod
    def around(cls, controller: pa.Controller, share: float) -> Observed:
        """Return a controller with an observer of so many of its bandwidths."""
        made: Any = copy.copy(controller)
        made.__class__ = cls
        made.k = share * controller.motion.bandwidth  # type: ignore[union-attr]
        return made

    def step(
        self, state: ControllerState, measurement: Measurement, desired: Desired, dt: float
    ) -> tuple[np.ndarray, ControllerState]:
        """Return the torque (n) to hold for the next dt [s], and the next state."""
        torque, after = super().step(state, measurement, desired, dt)
        model, data, (q, v) = self.kinematics.robot.model, self._data, after.sensed[:2]
        momentum = pin.crba(model, data, q) @ v
        p = momentum if self.p is None else self.p
        r = self.k * (momentum - p)
        efforts = effort_limits(model)
        torque = np.clip(torque - r, -efforts, efforts)
        known = v @ pin.computeCoriolisMatrix(model, data, q, v)
        known = known - pin.computeGeneralizedGravity(model, data, q)
        self.p = p + dt * (torque + known + r)
        return torque, after


ADAPTATIONS = {"none": "none", "natural": "natural", "default": None}
OBSERVERS = {"observer 3 w": 3.0, "observer 10 w": 10.0}
CONTENDERS = (*ADAPTATIONS, *OBSERVERS)


def controller_of(contender: str, robot: pa.Robot, **options: Any) -> pa.Controller:
    """Return the controller of a contender for a model."""
    adaptation = ADAPTATIONS.get(contender, "none")
    made = pa.make_controller(robot, **options)
    if adaptation != "none":
        return pa.make_controller(robot, adaptation=adaptation, **options)
    options |= {"adaptation": "none", "kinematic_adaptation": made.adaptation_k}
    made = pa.make_controller(robot, **options)
    return Observed.around(made, OBSERVERS[contender]) if contender in OBSERVERS else made


# --- runs ---


case_of = cache(zoo_case)


def simulated(
    robot: str, case: Reality, contender: str, seed: int, axis: str
) -> tuple[pa.Controller, pa.Rollout]:
    """Return the controller and its run; see ``measure``."""
    zoo = case_of(robot, seed)
    unknown = pa.Unknown()
    n = case.duration
    true = zoo.true
    model = zoo.estimated
    own = zoo.true.friction
    actuators = pa.robot.Actuators(delay=case.late)
    elastic = math.isfinite(case.stiffness)
    if elastic:
        inertia = np.diag(pin.crba(true.model, true.model.createData(), true.q0))
        rotors = np.maximum(ROTOR[0] * inertia, ROTOR[1] * inertia.max())
        true = true.changed(armature=rotors)
        model = model.changed(armature=rotors)
        unknown = pa.Unknown(armature=False)
        K = case.stiffness / levers(true) ** 2
        damping = 2.0 * case.damping * np.sqrt(K * rotors)
        actuators = pa.robot.Actuators(delay=case.late, stiffness=K, damping=damping)
    cooler = {}
    for t in np.arange(0.0, n - 0.05, 0.1).tolist() if case.warms else [0.0]:
        share = WARM[0] ** (-t / WARM[1])
        friction = pa.Friction(
            share * own.viscous,
            share * case.coulomb * own.coulomb,
            breakaway=np.array(case.breakaway),
            fading=np.array(FADING),
        )
        cooler[t] = true.changed(friction=friction)
    controller = controller_of(
        contender,
        model,
        unknown=unknown,
        sensors=case.sensors if case.declared else pa.Sensors(),
        dt=case.dt,
        limits=pa.Limits(guards={"velocity": False}),
    )
    plant = partial(ElasticArm if elastic else RigidArm, case=case, seed=seed, axis=axis)
    return controller, pa.simulate(
        cooler.pop(0.0),
        controller,
        zoo.motion,
        duration=n,
        sensors=case.sensors,
        engine=pa.Engine(plant, actuators=actuators),
        events=pa.Events(cooler),
        seed=seed,
        progress=False,
    )


def weights(controller: pa.Controller, a_d: np.ndarray, true: pa.Robot) -> np.ndarray:
    """Return how heavy the arm is in the estimates (N, p), at home, relative to its weight (N).

    That is g^T g_hat / g^T g of the gravity torques. A sum of masses would hold what no motion
    shows.
    """
    still = np.zeros(true.model.nv)
    g = pin.computeGeneralizedGravity(true.model, true.model.createData(), true.q0)
    columns = g @ controller.dynamics.regressor(true.q0, still, still)
    return np.asarray(a_d @ columns / (g @ g))


@quiet()  # of descriptions with unphysical bodies, and of ringing
def measure(
    robot: str,
    reality: str,
    contender: str,
    case_seed: int = 0,
    force: float | None = None,
    axis: str | None = None,
    duration: float | None = None,
) -> dict[str, Any]:
    """Return the figures of one run.

    Args:
        robot: name in the catalogue.
        reality: name of a reality.
        contender: name of a contender.
        case_seed: of tool, load, friction, errors of the model, noise, and direction of a push.
        force: of the push in place of the reality's [N].
        axis: its direction, as "-z"; None: by the seed.
        duration: of the run in place of the reality's [s].

    The error is the largest of the last half turn, in which each joint turns around, relative to
    the radius. Lost is who diverges, or errs by more than the radius then. Of a push: the largest
    error [m], the time until it is back [s], and the weight at the end of the push, a second later
    and in the end.
    """
    case = REALITIES[reality]
    zoo = case_of(robot, case_seed)
    case = replace(
        case,
        push=case.push if force is None else force,
        duration=duration or case.duration,
    )
    given = robot, case, contender, case_seed, axis or AXES[case_seed % len(AXES)]
    controller, rollout = simulated(*given)
    t = rollout.t
    error = rollout.distance
    start = 0.5 * case.duration
    last = error[t > case.duration - 0.5 * zoo.period]
    if rollout.diverged is not None or not last.max() < zoo.radius:
        return {"status": "diverged", "reason": f"lost after {t[-1]:.1f} s"}
    weight = weights(controller, rollout.a_d, zoo.true)
    found = {"error": float(last.max()) / zoo.radius, "weight": float(weight[-1])}
    if case.push:
        late = t >= start + PUSHED
        before = (t > 1.0) & (t < start)
        away = t[late & (error > error[before].max() + BAND)]
        found |= {
            "pushed": float(error[(t >= start) & (t < start + 2.0 * PUSHED)].max()),
            "back": float(away[-1] - start - PUSHED) if away.size else 0.0,
            "after": float(weight[late][0]),
            "second": float(weight[t >= start + PUSHED + 1.0][0]),
        }
    return found


def contenders(rows: Iterable[Row]) -> str:
    """Return median and worst error of each contender in each reality, and how many are lost."""
    lines = []
    for reality, own in grouped([row for row in rows if not row["force"]], "reality").items():
        line = [reality]
        runs = grouped(own, "contender")
        for contender in CONTENDERS:
            errors = [100.0 * row["error"] for row in runs[contender] if row["error"] is not None]
            lost = len(runs[contender]) - len(errors)
            words = f", {lost} of {len(runs[contender])} lost" if lost else ""
            line.append(spread(errors) + words)
        lines.append(line)
    return markdown(["error [%]", *CONTENDERS], lines)
