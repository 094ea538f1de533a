"""The default and its rivals in realities that no proof knows.

``make realities.table`` runs the sweep ``realities.toml``: the case of the zoo (tool, load,
inertias and friction unknown, a circle) where encoders, motors, gears, friction or the world
around the arm are not those of the model. For a look at some of them, in this process::

    python -m benchmarks.realities --robots panda,z1 --realities perfect,push --contenders default

Contenders: no adaptation of the dynamics ("none"), "natural", the library's default, and two
momentum observers, which add the disturbance torque that they see to "none". All learn the
kinematics as the default does. What a reality adds is unknown to the controller, but for declared
encoders, a camera, the period, and rotor inertias where joints give way.
"""

from __future__ import annotations

import argparse
import math
import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache, partial
from itertools import product
from statistics import median
from time import perf_counter
from typing import Any

import numpy as np
import pinocchio as pin

import pinadapt as pa
from pinadapt.description.chain import angles_from_configuration, effort_limits, is_slide
from pinadapt.models import SensedState, TaskKinematics
from pinadapt.plants.elastic_plant import ElasticPlant
from pinadapt.plants.pinocchio_plant import PinocchioPlant
from pinadapt.plants.plant import SimulatedPlant
from pinadapt.records import Measurement
from pinadapt.zoo.experiment import ZooCase, zoo_case

from .contenders.nominal_robot import NominalRobot
from .timing import markdown

DURATION = 6.0  # [s] of a run; 8 s cost a third more and show the warming up to its end
PUSHED = 0.5  # [s] from half of the run on
BAND = 1e-3  # [m]; back is who is nearer than this to the largest error between 1 s and the push
ROTOR = 0.5, 1e-3  # of the inertia that each joint moves, and least, of the largest of these
LEVER = 0.1  # [m] at which a slide's N/m are those of a joint's N m/rad
TEETH = 200.0  # periods of the ripple in a turn: a harmonic drive of 1:100 has two a motor turn
COOLING = 3.0, 8.0  # friction falls to a third in 8 s
DRY = {"coulomb": 2.0, "breakaway": 1.5, "fading": 0.05}  # twice, half more at rest, [rad/s]
AXES = "+x", "-y", "-z", "-x", "+y", "+z"  # of a push, by the seed
ROBOTS = "panda", "ur5", "ur10", "z1", "kinova", "xarm7", "scara", "g1_left_arm"


@dataclass(frozen=True)
class Reality:
    """What is not as in the model.

    Attributes:
        sensors: of the robot.
        declared: whether the controller knows the sensors.
        dt: period [s].
        late: delay of the motors [s].
        stiffness: of the joints [N m/rad].
        backlash: whole play of each gear [rad].
        damping: of the joints, as a share of the critical one of the rotors.
        ripple: amplitude of the torque, of the effort limits.
        dry: whether friction is dry, with a Stribeck effect.
        warms: whether friction falls during the run.
        torque_off: offset of the measured torque, of the effort limits; None: it is not measured.
        push: force on the tool from half of the run on [N].
    """

    sensors: pa.Sensors = field(default_factory=pa.Sensors)
    declared: bool = True
    dt: float = 1e-3
    late: float = 0.0
    stiffness: float = math.inf
    backlash: float = 0.0
    damping: float = 0.0
    ripple: float = 0.0
    dry: bool = False
    warms: bool = False
    torque_off: float | None = None
    push: float = 0.0


def encoder(bits: int) -> dict[str, float]:
    """Return encoders of so many bits a turn."""
    return {"encoder": 2.0 * math.pi / 2**bits}


REALITIES = {
    "perfect": Reality(),
    "17 bit declared": Reality(pa.Sensors(**encoder(17))),
    "17 bit": Reality(pa.Sensors(**encoder(17)), declared=False),
    "14 bit declared": Reality(pa.Sensors(**encoder(14))),
    "14 bit": Reality(pa.Sensors(**encoder(14)), declared=False),
    **{f"motors {ms} ms late": Reality(late=1e-3 * ms) for ms in (2, 5, 10, 12, 15)},
    **{f"joints {k} kN m/rad": Reality(stiffness=1e3 * k) for k in (20, 5, 2)},
    "backlash": Reality(stiffness=2e4, backlash=5e-4, damping=0.1),
    "ripple": Reality(ripple=0.01),
    "dry friction": Reality(dry=True),
    "warming up": Reality(warms=True),
    "torque sensor off": Reality(torque_off=0.01),
    "push": Reality(push=40.0),
    "frames lost": Reality(pa.Sensors(pa.Camera(rate=30.0, delay=0.06, dropout=0.3))),
    "500 Hz": Reality(dt=2e-3),
    "250 Hz": Reality(dt=4e-3),
    "all of it": Reality(
        pa.Sensors(pa.Camera(rate=30.0, delay=0.06, dropout=0.1), **encoder(17)),
        late=3e-3,
        stiffness=2e4,
        backlash=2e-4,
        damping=0.1,
        ripple=0.005,
        dry=True,
        warms=True,
        torque_off=0.005,
        push=20.0,
    ),
}


# --- the arm ---


class Unmodelled:
    """Torques of an arm that its description does not have, and its torque sensors.

    Attributes:
        case: what there is.
        efforts: (n) effort limits [N m or N].
        phase: (n) of the ripple [rad].
        force: (3) of the push, in world axes [N].
        start: of the push [s].
    """

    def __init__(self, case: Reality, true: pa.Robot, seed: int, start: float, axis: str) -> None:
        """Take a reality, whose push has the direction of an axis, as "-z"."""
        n = true.model.nv
        self.case, self.start = case, start
        self.efforts = effort_limits(true.model)
        self.phase = np.random.default_rng(seed).uniform(0.0, 2.0 * math.pi, n)
        self.force = np.zeros(3)
        self.force["xyz".index(axis[1])] = case.push if axis[0] == "+" else -case.push
        self.ripples, self.given = case.ripple * self.efforts, np.zeros(n)

    def of_motors(self, plant: SimulatedPlant, q: np.ndarray) -> np.ndarray | float:
        """Return the ripple (n) at the configuration q (nq) of the motors [N m or N]."""
        if not self.case.ripple:
            return 0.0
        angles = angles_from_configuration(plant.robot.model, q)
        return self.ripples * np.sin(TEETH * angles + self.phase)

    def of_links(
        self, model: pin.Model, data: pin.Data, frame: int, q: np.ndarray, t: float
    ) -> np.ndarray | float:
        """Return J^T F (n) of the push at q (nq) and t [s] [N m or N]."""
        if not self.case.push or not -1e-9 < t - self.start < PUSHED - 1e-9:
            return 0.0
        J = pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL_WORLD_ALIGNED)
        return np.asarray(self.force @ J[:3])

    def sensed(self, truth: Measurement) -> Measurement:
        """Return a measurement, with the torque where it is measured."""
        if self.case.torque_off is None:
            return truth
        return truth._replace(tau=self.given + self.case.torque_off * self.efforts)


class RigidArm(PinocchioPlant):
    """A rigid arm with ``Unmodelled`` torques."""

    def __init__(self, robot: pa.Robot, *, extra: Unmodelled, **options: Any) -> None:
        """Take the robot and what its description does not have."""
        self._extra = extra
        super().__init__(robot, **options)

    def measure(self) -> Measurement:
        """Return what ideal sensors measure, the torque with its offset."""
        return self._extra.sensed(super().measure())

    def hold(self, tau: np.ndarray, dt: float) -> None:
        """Move for dt [s] under a torque tau (n) of the motors and what comes besides."""
        extra, count = self._extra, self.steps_in(dt)
        q, v, t, h = self._q, self._v, self._t, dt / count
        for k in range(count):
            applied = tau + extra.of_motors(self, q)
            links = extra.of_links(self._model, self._data, self.robot.frame_id, q, t + k * h)
            q, v = self._integrate(q, v, applied + links, h)
        self._q, self._v, self._t, extra.given = q, v, t + dt, tau


class ElasticArm(ElasticPlant):
    """An arm with springs that have a play, any friction of its motors, and ``Unmodelled`` torques.

    The spring of a joint has the torque K (d - b) beyond half of its play b, and none within.
    The step is that of ``ElasticPlant``; with a play the stiffness is the secant of the torque
    between start and end of the step, the end as its first stage predicts it.
    """

    def __init__(self, robot: pa.Robot, *, extra: Unmodelled, **options: Any) -> None:
        """Take the robot and what its description does not have."""
        self._extra, self._half = extra, 0.5 * extra.case.backlash
        self.longest_step = 5e-4 if self._half else self.longest_step  # halving it: under 1 %
        super().__init__(robot, **options)

    def reset(self) -> None:
        """Return home at rest, with the springs loaded by gravity."""
        super().reset()
        self._d = self._d + self._half * np.sign(self._d)

    def _take(self, robot: pa.Robot) -> None:
        """Copy the model of a robot; its rotor inertias become those of the motors."""
        self.robot, self._B, self._friction = robot, np.array(robot.model.armature), robot.friction
        self._model = robot.model.copy()
        self._model.armature = np.zeros(self.nv)
        self._data, self._moved = self._model.createData(), self._model.copy()
        self._armature, self._scratch = self._moved.armature, self._moved.createData()

    def measure(self) -> Measurement:
        """Return what ideal sensors measure, the torque with its offset."""
        return self._extra.sensed(super().measure())

    def springs_torque(self, d: np.ndarray) -> np.ndarray:
        """Return the torque (n) of the springs at a deflection d (n) [N m or N]."""
        return np.asarray(self._K * (d - np.clip(d, -self._half, self._half)))

    def hold(self, tau: np.ndarray, dt: float) -> None:
        """Move for dt [s] under a torque tau (n) of the motors and what comes besides."""
        extra, count, K = self._extra, self.steps_in(dt), self._K
        h, frame, model = dt / count, self.robot.frame_id, self._model
        for _ in range(count):
            q, v, w, d = self._links, self._v, self._w, self._d
            force = extra.of_links(model, self._data, frame, q, self._t)
            drive = tau + extra.of_motors(self, pin.integrate(model, q, d))
            pull = self.springs_torque(d)
            if self._half:  # tangent
                K = np.where(np.abs(d) > self._half, self._K, 0.0)
            v_way, w_way = self._means(q, v, w, drive, force, pull, K, 0.5 * h)
            if self._half:
                way = h * (w_way - v_way)
                change = self.springs_torque(d + way) - pull
                K = np.where(np.abs(way) > 1e-12, change / np.where(way == 0.0, 1.0, way), K)
            middle = pin.integrate(model, q, 0.5 * h * v_way)
            v_way, w_way = self._means(
                middle, 2.0 * v_way - v, 2.0 * w_way - w, drive, force, pull, K, h
            )
            self._links = pin.integrate(model, q, h * v_way)
            self._d = d + h * (w_way - v_way)
            self._v, self._w = 2.0 * v_way - v, 2.0 * w_way - w
            self._t += h
        extra.given = tau

    def _means(  # type: ignore[override]
        self,
        q: np.ndarray,
        v: np.ndarray,
        w: np.ndarray,
        tau: np.ndarray,
        force: np.ndarray | float,
        pull: np.ndarray,
        K: np.ndarray,
        h: float,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the mean velocities (n) of links and motors over h [s] from the current state.

        M, C v + g and the secant F of the friction are those at q, v and w. The motors' mean
        velocity is (drive + S v_mean) / E; what is left for the links is their own equation with a
        rotor inertia of S (E - S) / E h / 2, which the articulated-body algorithm solves.
        """
        friction, inertia = self._friction, 2.0 / h * self._B
        slow = np.maximum(np.abs(w), 1e-9)
        F = friction.viscous + friction.coulomb * friction.smoothed_sign(slow) / slow
        z = np.maximum(h * F / self._B, 1e-3)
        theta = -1.0 / np.expm1(-z) - 1.0 / z
        S = 0.5 * h * K + self._D
        E = inertia + S + 2.0 * theta * F
        drive = tau - pull + (inertia - (1.0 - 2.0 * theta) * F) * self._w
        R = S * (E - S) / E
        self._armature[:] = 0.5 * h * R
        a = pin.aba(self._moved, self._scratch, q, v, pull + force + S / E * drive - R * self._v)
        v_mean = self._v + 0.5 * h * a
        return v_mean, (drive + S * v_mean) / E


# --- contenders ---


class Observing(pa.filters.Filters):
    """The filters of a law, and the momentum p of an observer; see ``Observed``."""

    def __init__(self, law: Observed) -> None:
        """Take the law."""
        self._law, self._inner = law, super(Observed, law).filters

    def init(self, sensed: SensedState, kinematics: TaskKinematics) -> Any:
        """Return the filters' state at the first sample, and p = M v."""
        momentum = self._law.nominal.momentum(sensed.q, sensed.v)
        return self._inner.init(sensed, kinematics), momentum

    def observe(self, state: Any, sensed: SensedState, kinematics: TaskKinematics) -> Any:
        """Return what the filters observe, and p."""
        return self._inner.observe(state[0], sensed, kinematics), state[1]

    def step(self, state: Any, s: pa.laws.Signals, dt: float) -> Any:
        """Return the state after dt [s]."""
        inner, p = s.filtered
        rate = self._law.sent + self._law.nominal.momentum_rate(s.q, s.v) + self._law.observed(s)
        return self._inner.step(state[0], s.replaced(filtered=inner), dt), p + dt * rate

    def rate(self, state: Any, s: pa.laws.Signals) -> Any:
        """Refuse: sampled only."""
        raise NotImplementedError


class Observed(pa.laws.Law):
    """A law less the disturbance torque r of a momentum observer, dr/dt = k (d - r).

    r = k (M v - p), dp/dt = tau + C^T v - g + r, all of the nominal robot: A. De Luca, R. Mattone,
    *Actuator failure detection and isolation using generalized momenta*, ICRA 2003.

    Attributes:
        nominal: the nominal robot.
        k: rate of the observer [1/s].
        sent: (n) the last torque [N m or N].
    """

    nominal: NominalRobot
    k: float
    sent: np.ndarray

    @classmethod
    def around(cls, law: pa.laws.Law, robot: pa.Robot, k: float) -> pa.laws.Law:
        """Return a law that was made, with an observer."""
        made = object.__new__(type("Observed", (cls, type(law)), {}))
        own = {name: value for name, value in vars(law).items() if name != "filters"}
        made.__dict__.update(own, nominal=NominalRobot(robot), k=k, sent=np.zeros(robot.model.nv))
        return made

    @property
    def filters(self) -> Observing:
        """The law's filters and the observer."""
        return Observing(self)

    def observed(self, s: pa.laws.Signals) -> np.ndarray:
        """Return r (n) [N m or N]."""
        return np.asarray(self.k * (self.nominal.momentum(s.q, s.v) - s.filtered[1]))

    def command(self, s: pa.laws.Signals, model: pa.laws.EstimatedModel) -> pa.laws.Command:
        """Return the law's command less r, within the effort limits."""
        found = super().command_unchecked(s.replaced(filtered=s.filtered[0]), model)
        torque = self.nominal.limited(found.torque - self.observed(s))
        self.__dict__["sent"] = torque
        return pa.laws.Command(torque, found.drives)


ADAPTATIONS: dict[str, str | None] = {"none": "none", "natural": "natural", "default": None}
OBSERVERS = {"observer 3 w": 3.0, "observer 10 w": 10.0}
CONTENDERS = (*ADAPTATIONS, *OBSERVERS)


def controller_of(contender: str, robot: pa.Robot, **options: Any) -> pa.Controller:
    """Return the controller of a contender for a model."""
    made = pa.make_controller(robot, adaptation=ADAPTATIONS.get(contender), **options)
    if ADAPTATIONS.get(contender, "none") != "none":
        return made
    made = pa.make_controller(
        robot, adaptation="none", kinematic_adaptation=made.adaptation_k, **options
    )
    if contender not in OBSERVERS:
        return made
    assert made.motion is not None
    names = (
        "kinematics",
        "dynamics",
        "adaptation_k",
        "adaptation_d",
        "limits",
        "senses",
        "motion",
        "compensation",
        "period",
        "nominal",
    )
    law = Observed.around(made.law, robot, OBSERVERS[contender] * made.motion.bandwidth)
    return pa.Controller(law, **{name: getattr(made, name) for name in names})


# --- runs ---


case_of = cache(zoo_case)


def cooled(robot: pa.Robot, duration: float) -> pa.Events:
    """Return the fall of a robot's friction, every 0.1 s."""
    friction, times = robot.friction, np.arange(0.1, duration - 0.05, 0.1)
    shares = zip(times.tolist(), (COOLING[0] ** (-times / COOLING[1])).tolist(), strict=True)
    return pa.Events(
        changes={
            t: robot.changed(viscous=share * friction.viscous, coulomb=share * friction.coulomb)
            for t, share in shares
        }
    )


def with_rotors(true: pa.Robot, robots: Iterable[pa.Robot]) -> list[pa.Robot]:
    """Return robots with the rotor inertias of the true one."""
    own = np.diag(pin.crba(true.model, true.model.createData(), true.q0))
    rotors = np.maximum(ROTOR[0] * own, ROTOR[1] * own.max())
    return [robot.changed(armature=rotors) for robot in robots]


def springs(case: Reality, true: pa.Robot) -> pa.robot.Actuators:
    """Return the actuators of a reality."""
    if math.isinf(case.stiffness):
        return pa.robot.Actuators(delay=case.late)
    slides = np.array([is_slide(joint) for joint in true.model.joints[1:]])
    K = case.stiffness * np.where(slides, LEVER**-2, 1.0)
    damping = 2.0 * case.damping * np.sqrt(K * true.model.armature)
    return pa.robot.Actuators(delay=case.late, stiffness=K, damping=damping)


def simulated(
    robot: str,
    reality: Reality,
    contender: str,
    case_seed: int,
    axis: str,
    duration: float,
) -> tuple[ZooCase, pa.Rollout]:
    """Return the case and its run."""
    zoo, unknown = case_of(robot, case_seed), pa.Unknown()
    true, model = zoo.true, zoo.estimated
    if reality.dry:
        own = true.friction
        dry = {"breakaway": DRY["breakaway"], "fading": DRY["fading"]}
        friction = pa.Friction(own.viscous, DRY["coulomb"] * own.coulomb, **dry)
        true = true.changed(friction=friction)
    elastic = math.isfinite(reality.stiffness)
    if elastic:
        true, model = with_rotors(true, (true, model))
        unknown = pa.Unknown(armature=False)
    extra = Unmodelled(reality, true, case_seed, 0.5 * duration, axis)
    controller = controller_of(
        contender,
        model,
        unknown=unknown,
        sensors=reality.sensors if reality.declared else pa.Sensors(),
        dt=reality.dt,
        limits=pa.Limits(guards={"velocity": False}),
    )
    rollout = pa.simulate(
        true,
        controller,
        zoo.motion,
        duration=duration,
        sensors=reality.sensors,
        engine=pa.Engine(
            partial(ElasticArm if elastic else RigidArm, extra=extra),
            actuators=springs(reality, true),
        ),
        events=cooled(true, duration) if reality.warms else None,
        seed=case_seed,
        progress=False,
    )
    return zoo, rollout


def measure(
    robot: str,
    reality: str,
    contender: str,
    case_seed: int = 0,
    force: float | None = None,
    axis: str | None = None,
    duration: float = DURATION,
) -> dict[str, Any]:
    """Return the figures of one run.

    Args:
        robot: name in the catalogue.
        reality: name of a reality.
        contender: name of a contender.
        case_seed: of tool, load, friction, errors of the model, noise, and direction of a push.
        force: of the push in place of the reality's [N].
        axis: its direction, as "-z"; None: by the seed.
        duration: of the run [s].
    """
    case = REALITIES[reality]
    case = case if force is None else replace(case, push=force)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of descriptions with unphysical bodies, and of ringing
        zoo, rollout = simulated(
            robot, case, contender, case_seed, axis or AXES[case_seed % len(AXES)], duration
        )
    t, error, start = rollout.t, rollout.distance, 0.5 * duration
    last = t > 0.9 * duration
    lost = rollout.diverged is not None or not error[last].max() < zoo.radius
    found: dict[str, Any] = {"error": None, "first": float(error[t <= 1.0].max())}
    found |= dict.fromkeys(("pushed", "back", "before", "after", "mass", "chatter"))
    if lost:
        at = "" if rollout.diverged is None else f" at {rollout.diverged:.1f} s"
        return found | {"status": "diverged", "reason": f"lost{at}"}
    masses = [name.endswith(".m") for name in rollout.dynamic_names]
    mass = rollout.a_d[:, masses].sum(axis=1) / zoo.true.mass
    change = np.diff(rollout.tau[last], axis=0) / effort_limits(zoo.true.model)
    found |= {
        "error": float(error[last].max()) / zoo.radius,
        "mass": float(mass[-1]),
        "chatter": float(np.sqrt(np.mean(change**2))),
    }
    if case.push:
        before, later = (t > 1.0) & (t < start), t >= start + PUSHED
        away = later & (error > error[before].max() + BAND)
        found |= {
            "pushed": float(error[(t >= start) & (t < start + 2.0 * PUSHED)].max()),
            "back": float(t[away][-1] - start - PUSHED) if away.any() else 0.0,
            "before": float(mass[before][-1]),
            "after": float(mass[later][0]),
        }
    return found


# --- tables ---


COLUMNS = {
    "error": 100.0,
    "first": 1e3,
    "pushed": 1e3,
    "back": 1.0,
    "before": 1.0,
    "after": 1.0,
    "mass": 1.0,
    "chatter": 100.0,
}
HEAD = (
    "lost",
    "error [%]",
    "first second [mm]",
    "pushed [mm]",
    "back [s]",
    "mass before",
    "after",
    "at the end",
    "chatter [%]",
)


def of_group(rows: Iterable[Mapping[str, Any]]) -> list[str]:
    """Return the cells of one reality and contender: lost, then median / worst.

    The worst mass is the one that is farthest from the true one, as a factor.
    """
    rows = list(rows)
    held = [row for row in rows if row["error"] is not None]
    cells = [f"{len(rows) - len(held)} of {len(rows)}" if len(held) < len(rows) else ""]
    for key, scale in COLUMNS.items():
        values = [scale * row[key] for row in held if row[key] is not None]
        if not values:
            cells.append("")
            continue
        factor = key in ("before", "after", "mass")
        worst = max(values, key=lambda x: abs(math.log(max(x, 1e-9))) if factor else x)
        both = dict.fromkeys(f"{value:.2g}" for value in (median(values), worst))
        cells.append(" / ".join(both))
    return cells


def report(rows: Iterable[Mapping[str, Any]]) -> str:
    """Return a table in Markdown with one line for each reality and contender."""
    groups: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    for row in rows:
        groups.setdefault((row["reality"], row["contender"]), []).append(row)
    lines = [
        [*key, *of_group(groups[key])] for key in product(REALITIES, CONTENDERS) if key in groups
    ]
    return markdown(("reality", "contender", *HEAD), lines)


# --- a quick look ---


def main() -> None:
    """Run some cases in this process and print their table, and the time of each."""
    parser = argparse.ArgumentParser(description="Run cases in this process; print their table.")
    parser.add_argument("--robots", default=",".join(ROBOTS))
    parser.add_argument("--realities", default=",".join(REALITIES))
    parser.add_argument("--contenders", default=",".join(CONTENDERS))
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=DURATION)
    parser.add_argument("--force", type=float, help="of the push [N]")
    parser.add_argument("--axis", help="of the push, as -z; default: by the seed")
    parser.add_argument("--each", action="store_true", help="print every case")
    given = parser.parse_args()
    names = [each.split(",") for each in (given.robots, given.realities, given.contenders)]
    rows, started = [], perf_counter()
    for reality, contender, robot, seed in product(
        names[1], names[2], names[0], range(given.seeds)
    ):
        case = {"robot": robot, "reality": reality, "contender": contender, "case_seed": seed}
        begun = perf_counter()
        row = measure(**case, force=given.force, axis=given.axis, duration=given.seconds)
        rows.append(case | row)
        if given.each:
            took = f"{perf_counter() - begun:.1f} s"
            print(reality, contender, robot, seed, *of_group([row]), took, sep="\t", flush=True)
    print(report(rows))
    print(f"\n{(perf_counter() - started) / len(rows):.2f} s a case, {len(rows)} cases")


if __name__ == "__main__":
    main()
