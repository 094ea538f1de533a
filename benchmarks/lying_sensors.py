"""Sensor faults: how soon they are detected, and where the arm is by then.

``make lying_sensors.table`` runs the sweep ``lying_sensors.toml`` and writes ``lying_sensors.csv``:
cases of the zoo (tool, load, every inertia and the friction unknown, a circle) at 1 kHz, and from
the second second on one sensor lies. Each row is a fault of one robot under one law, beside the
same run without it:

* refused: time from the first wrong sample to the error [ms], none if all of it was bridged;
* farther: how much farther a joint went by then than without the fault, at most [deg or cm];
* torque: the largest one until then, of the limit of its motor;
* drift: how far a joint went in the 3 s after the error, on the torque of ``Controller.safe`` and
  with the fault going on [deg or cm];
* brakes: time after the error at which the state says that nothing is measured of a joint, so that
  only brakes rest it [ms]; drift is that until then.

Nothing of this is a proof: a sensor may lie in ways that no comparison shows.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
import pinocchio as pin

import pinadapt as pa
from pinadapt.description.chain import is_slide
from pinadapt.zoo.experiment import zoo_case

from .shared import Row, grouped, markdown, quiet

DT, BEGIN, LONGEST, AFTER = 1e-3, 1.0, 1.0, 3.0  # [s]
JOINT = 1  # that lies alone
Spoil = Callable[["Liar", pa.Measurement], pa.Measurement]


class Liar:
    """A sensor that lies from an instant on.

    Attributes:
        model: of the robot.
        count: of wrong samples before this one.
        first: the last true sample.
    """

    def __init__(self, robot: pa.Robot, spoil: Spoil) -> None:
        """Take the robot, and what spoils a true sample."""
        self.model = robot.model
        self._spoil = spoil
        self.count = 0
        self.first = pa.Measurement(0.0, robot.q0, np.zeros(robot.model.nv))

    def __call__(self, sample: pa.Measurement) -> pa.Measurement:
        """Return what is said in place of a true sample."""
        wrong = self._spoil(self, sample)
        self.count += 1
        return wrong

    def angles(self, sample: pa.Measurement, change: Callable[[np.ndarray], Any]) -> np.ndarray:
        """Return q with the joint's angle changed; a continuous joint's is that of its pair."""
        joint = self.model.joints[JOINT + 1]
        q = sample.q.copy()
        if joint.nq == 1:
            q[joint.idx_q] = change(q[joint.idx_q])
        else:
            angle = change(np.arctan2(q[joint.idx_q + 1], q[joint.idx_q]))
            q[joint.idx_q : joint.idx_q + 2] = np.cos(angle), np.sin(angle)
        return q


def _joint(values: np.ndarray, value: float) -> np.ndarray:
    """Return a copy with one joint's value replaced."""
    changed = values.copy()
    changed[JOINT] = value
    return changed


def _stuck_q(liar: Liar, s: pa.Measurement) -> pa.Measurement:
    joint = liar.model.joints[JOINT + 1]
    part = slice(joint.idx_q, joint.idx_q + joint.nq)
    q = s.q.copy()
    q[part] = liar.first.q[part]
    return s._replace(q=q)


def _off_the_circle(liar: Liar, s: pa.Measurement) -> pa.Measurement:
    q = s.q.copy()
    for joint in liar.model.joints[1:]:
        if joint.nq == 2:
            q[joint.idx_q : joint.idx_q + 2] *= 1.2
    return s._replace(q=q)


def _once(spoil: Spoil) -> Spoil:
    return lambda liar, s: spoil(liar, s) if liar.count == 0 else s


def _off(liar: Liar, s: pa.Measurement, by: float) -> pa.Measurement:
    return s if s.x is None else s._replace(x=s.x + by * np.eye(s.x.size)[0])


FAULTS: dict[str, Spoil] = {
    "v of a joint stuck": lambda a, s: s._replace(v=_joint(s.v, a.first.v[JOINT])),
    "v of a joint zero": lambda a, s: s._replace(v=_joint(s.v, 0.0)),
    "v of all joints stuck": lambda a, s: s._replace(v=a.first.v),
    "v of the wrong sign": lambda a, s: s._replace(v=-s.v),
    "v in degrees": lambda a, s: s._replace(v=np.degrees(s.v)),
    "v 50 rad/s, once": _once(lambda a, s: s._replace(v=_joint(s.v, 50.0))),
    "q of a joint stuck": _stuck_q,
    "encoder stuck, v zero with it": lambda a, s: _stuck_q(a, s)._replace(v=_joint(s.v, 0.0)),
    "q wraps by 2 pi": lambda a, s: s._replace(q=a.angles(s, lambda angle: angle - 2.0 * np.pi)),
    "q in degrees": lambda a, s: s._replace(q=np.degrees(s.q)),
    "q off by 0.5, once": _once(lambda a, s: s._replace(q=a.angles(s, lambda q: q + 0.5))),
    "q off by 0.1 for good": lambda a, s: s._replace(q=a.angles(s, lambda q: q + 0.1)),
    "(cos, sin) times 1.2": _off_the_circle,
    "x off by 1 m, once": _once(lambda a, s: _off(a, s, 1.0)),
    "x off by 0.3 m for good": lambda a, s: _off(a, s, 0.3),
    "x frozen": lambda a, s: s._replace(x=a.first.x),
    "torque 1e4 N m, once": _once(lambda a, s: s._replace(tau=np.full(s.v.size, 1e4))),
    "torque times 100": lambda a, s: s if s.tau is None else s._replace(tau=100.0 * s.tau),
    "time of every second sample": lambda a, s: s._replace(t=s.t - DT * (a.count % 2)),
    "time stands": lambda a, s: s._replace(t=a.first.t),
    "all repeated, time goes on": lambda a, s: a.first._replace(t=s.t),
    "v of a joint not a number": lambda a, s: s._replace(v=_joint(s.v, math.nan)),
    "v not a number": lambda a, s: s._replace(v=math.nan * s.v),
    "q of a joint not a number": lambda a, s: s._replace(q=a.angles(s, lambda angle: math.nan)),
    "q not a number": lambda a, s: s._replace(q=math.nan * s.q),
    "x not given": lambda a, s: s._replace(x=None),
    "q and v not a number": lambda a, s: s._replace(q=math.nan * s.q, v=math.nan * s.v),
}
CONTINUOUS = ("(cos, sin) times 1.2",)  # of robots that have such joints
WRAPS = ("q wraps by 2 pi",)  # which a continuous joint does not do
MEASURES = ("torque 1e4 N m, once", "torque times 100")


class Loop:
    """A closed loop on the case of a robot of the zoo, sample by sample.

    Attributes:
        true: the robot.
        controller: that drives it.
        plant: that it drives.
        liar: the sensors, once they lie.
        state: of the controller.
    """

    def __init__(self, name: str, law: str, measures: bool = False, dt: float = DT) -> None:
        """Take a robot, a law, whether torques are measured, and the period [s]."""
        case = zoo_case(name)
        self.true = case.true
        self.measures = measures
        self.dt = dt
        options: dict[str, Any] = {"adaptation": "least-squares"} if measures else {}
        self.controller = pa.make_controller(
            case.estimated,
            law=law,
            dt=dt,
            unknown=pa.Unknown(friction=True, armature=True),
            limits=pa.Limits(torque=case.efforts_suffice),
            **options,
        )
        self.plant = pa.plants.PinocchioPlant(self.true)
        self.motion = pa.reference.starting_from(case.motion, self.true, self.plant.measure())
        self.given: np.ndarray | None = None
        self.liar: Liar | None = None
        self.state = self.controller.init(self.plant.measure())
        self.sample = self.plant.measure()

    def lying(self, fault: str) -> Loop:
        """Return a copy whose sensors lie from now on."""
        other = copy.deepcopy(self)
        other.liar = Liar(self.true, FAULTS[fault])
        other.liar.first = self.sample
        return other

    def measured(self) -> tuple[pa.Measurement, pa.Measurement]:
        """Return the truth, and what the sensors say."""
        truth = self.plant.measure()
        self.sample = truth._replace(tau=self.given) if self.measures else truth
        return truth, self.sample if self.liar is None else self.liar(self.sample)

    def samples(self, duration: float) -> Iterator[tuple[pa.Measurement, np.ndarray]]:
        """Yield truth and torque of each sample until the controller refuses one."""
        for _ in range(round(duration / self.dt)):
            truth, sample = self.measured()
            desired = self.motion.at(truth.t)
            torque, self.state = self.controller.step(self.state, sample, desired, self.dt)
            yield truth, torque
            self.send(torque)

    def send(self, torque: np.ndarray) -> None:
        """Let the arm move on for a period."""
        self.given = self.plant.motors(torque)
        self.plant.step(torque, self.dt)

    def rest(self, duration: float) -> Iterator[pa.Measurement]:
        """Yield the truth while the arm is on the torque of ``Controller.safe``, without brakes."""
        for _ in range(round(duration / self.dt)):
            truth, sample = self.measured()
            yield truth
            torque, self.state = self.controller.safe(self.state, sample)
            if self.state.unseen.any():
                return
            self.send(torque)


def effect(loop: Loop, honest: list[np.ndarray]) -> dict[str, Any]:
    """Return what a fault does, that has just begun.

    Args:
        loop: whose sensors lie.
        honest: q (nq) of each sample from now on if they did not.
    """
    model = loop.true.model
    limit = np.where(model.effortLimit > 0.0, model.effortLimit, np.inf)
    found: dict[str, Any] = {"refused": None, "drift": 0.0, "brakes": None}
    share = 0.0
    farthest = 0.0
    k = 0
    try:
        for truth, torque in loop.samples(LONGEST):
            share = max(share, float((np.abs(torque) / limit).max()))
            farthest = max(farthest, _apart(model, honest[k], truth.q))
            k += 1
    except pa.PinadaptError:
        start = truth = loop.plant.measure()
        farthest = max(farthest, _apart(model, honest[k], start.q))
        found["refused"] = 1e3 * k * loop.dt
        for truth in loop.rest(AFTER):
            found["drift"] = max(found["drift"], _apart(model, start.q, truth.q))
        if loop.state.unseen.any():
            found["brakes"] = 1e3 * (truth.t - start.t)
    return found | {"farther": farthest, "torque": share}


def _apart(model: Any, q: np.ndarray, other: np.ndarray) -> float:
    """Return how far the farthest joint is from another place [deg, or cm of slides]."""
    unit = [1e2 if is_slide(joint) else math.degrees(1.0) for joint in model.joints[1:]]
    return float(np.abs(np.array(unit) * pin.difference(model, q, other)).max())


def begun(name: str, law: str, measures: bool = False, dt: float = DT) -> Loop:
    """Return a loop in motion, where a sensor may begin to lie."""
    loop = Loop(name, law, measures, dt)
    for _ in loop.samples(BEGIN):
        pass
    return loop


@lru_cache(maxsize=2)
def before(name: str, law: str, measures: bool) -> tuple[Loop, list[np.ndarray]]:
    """Return a loop in motion, and q (nq) of each sample that would follow."""
    loop = begun(name, law, measures)
    return loop, [s.q for s, _ in copy.deepcopy(loop).samples(LONGEST + 0.1)]


@quiet()
def measure(robot: str, law: str, fault: str) -> dict[str, Any]:
    """Return what a fault does.

    Raises:
        InputError: the robot cannot have it.
    """
    loop, honest = before(robot, law, fault in MEASURES)
    model = loop.true.model
    wraps = model.joints[JOINT + 1].nq == 1
    if (fault in WRAPS and not wraps) or (fault in CONTINUOUS and model.nq == model.nv):
        raise pa.InputError("this robot cannot have it.", where=fault)
    return effect(loop.lying(fault), honest)


def report(rows: Sequence[Row]) -> str:
    """Return a table in Markdown: the worst of the robots, faults of one outcome in a row."""
    shown = [row for row in rows if (row["law"], row["status"]) == ("separation", "done")]
    found = grouped(shown, "fault")
    told = [
        {**row, "outcome": outcome}
        for own in found.values()
        for outcome in [_outcome(own)]
        for row in own
    ]
    cells = []
    for outcome, own in grouped(told, "outcome").items():
        far, torque, drift = (
            max(row[key] for row in own) for key in ("farther", "torque", "drift")
        )
        faults = "; ".join(grouped(own, "fault"))
        worst = f"{far:.2g}°", f"{100.0 * torque:.0f} %", f"{drift:.2g}°"
        cells.append([faults, outcome, *worst])
    return markdown(["fault", "outcome", "deviation", "torque", "drift"], cells)


def _outcome(rows: Sequence[Row]) -> str:
    """Return how the runs with a fault ended."""
    missed = [row["robot"] for row in rows if row["refused"] is None]
    if missed:
        return "bridged" if len(missed) == len(rows) else f"not within 1 s: {', '.join(missed)}"
    if all(row["brakes"] is not None for row in rows):
        return f"refused within {SOON:.0f} ms, needs brakes"
    late = max(row["refused"] for row in rows)
    return f"refused after {late:.0f} ms" if late > SOON else f"refused within {SOON:.0f} ms"


SOON = 20.0  # [ms]
