"""A memory of all torques compared with "natural" and none, in cases outside of the proofs.

``make adaptations.table`` runs the sweep ``adaptations.toml``, ``make actuators.table`` the sweep
``actuators.toml``: the case of the zoo (tool, load, inertias and friction unknown, a circle) with
the default law, also without adaptation with the lag of K_D that a memory has. A reality adds
encoders or a camera that is 60 ms late, which are declared to the controller; a load twice as heavy
from half of the run on, announced or not; motors that are late and joints that give way, declared
or not; a slower loop; or friction that the user calls known though the model has none. Poses are
controlled in place of positions where the arm has joints enough.

Of the last tenth of a run are the largest error relative to the radius and the rms change of the
torque between samples; the mass is the estimated one of all bodies over the true one, its inverse
where that is larger. Where the load changes, the error around one second after it is shown too.

The first lines of the table are those of all chains of the catalogue, ideally measured and moved
(``make zoo.table``), and of robots of other packages (``make strangers.table``). Below the table
stand the cells in which the default, the memory but where friction is called known, is worse than
it may be: the median above that of "natural" by a tenth or its worst by half, or either above that
of no adaptation, with its own lag or with the memory's.
``python -m benchmarks.adaptations`` prints them.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import product
from statistics import median
from typing import Any

import numpy as np
import pinocchio as pin

import pinadapt as pa
from pinadapt.sweep.table import REFUSED
from pinadapt.zoo.experiment import LOAD, ZooCase, zoo_case

from .timing import markdown, table_rows, two_digits

ADAPTATIONS: dict[str, dict[str, Any]] = {
    "none": {"adaptation": "none"},
    "natural": {"adaptation": "natural"},
    "natural-memory": {"adaptation": "natural-memory"},
    "none, lag 10 ms": {"adaptation": "none", "lag": 0.01},
    "none, declared": {"adaptation": "none"},
    "natural, declared": {"adaptation": "natural"},
    "natural-memory, declared": {"adaptation": "natural-memory"},
}
DECLARED, MEMORY = "declared", "natural-memory"
ROTOR = 0.5, 1e-3  # of the inertia that each joint moves, and least, of the largest of these
ANNOUNCED, UNANNOUNCED = "announced", "unannounced"
ZOO = {"position": "zoo, positions", "pose": "zoo, poses"}
IN_ZOO = {"": MEMORY, "natural": "natural"}  # the default of the zoo is the memory
STRANGERS = {"perfect": "strangers", "camera": "strangers, camera of 30 Hz"}
IN_STRANGERS = {"": MEMORY, "natural": "natural", "unadapted": "none"}


@dataclass(frozen=True)
class Reality:
    """What one column adds to the case of the zoo.

    Attributes:
        sensors: of the robot, declared to the controller.
        actuators: of the robot; None: ideal ones.
        dt: period [s].
        duration: of the run [s].
        change: whether the load becomes twice as heavy, and whether that is announced.
        friction_known: whether the friction is called known; the model has none.
        rotors: whether the joints have rotors, which are known.
        task: in place of the catalogue's.
    """

    sensors: pa.Sensors = field(default_factory=pa.Sensors)
    actuators: pa.robot.Actuators | None = None
    dt: float = 1e-3
    duration: float = 16.0
    change: str = ""
    friction_known: bool = False
    rotors: bool = False
    task: str | None = None


def encoder(bits: int) -> pa.Sensors:
    """Return encoders of so many bits a turn."""
    return pa.Sensors(encoder=2.0 * math.pi / 2**bits)


REALITIES = {
    "perfect": Reality(),
    "poses": Reality(task="pose"),
    "camera of 30 Hz": Reality(pa.Sensors(pa.Camera(rate=30.0, delay=0.06))),
    "17 bit": Reality(encoder(17), duration=60.0),
    "14 bit": Reality(encoder(14), duration=60.0),
    "load changes": Reality(change=UNANNOUNCED),
    "load announced": Reality(change=ANNOUNCED),
    "friction called known": Reality(friction_known=True),
    "motors 2 ms late": Reality(actuators=pa.robot.Actuators(delay=2e-3)),
    "motors 6 ms late": Reality(actuators=pa.robot.Actuators(delay=6e-3)),
    "motors 10 ms late": Reality(actuators=pa.robot.Actuators(delay=10e-3)),
    "motors of 100 rad/s": Reality(actuators=pa.robot.Actuators(bandwidth=100.0)),
    "motors of 50 rad/s": Reality(actuators=pa.robot.Actuators(bandwidth=50.0)),
    "joints 20 kN m/rad": Reality(actuators=pa.robot.Actuators(stiffness=2e4), rotors=True),
    "joints 5 kN m/rad": Reality(actuators=pa.robot.Actuators(stiffness=5e3), rotors=True),
    "500 Hz": Reality(dt=2e-3),
    "250 Hz": Reality(dt=4e-3),
}

CELLS = (*ZOO.values(), *STRANGERS.values(), *REALITIES)


def events(name: str, zoo: ZooCase, half: float, change: str) -> pa.Events | None:
    """Return the change of the load at a time [s], and its announcement."""
    if not change:
        return None
    bodies = [inertia.mass for inertia in pa.load(name).model.inertias[1:]]
    mass = min(LOAD * sum(bodies), bodies[-1])  # as the zoo has it
    heavier = {half: zoo.true.changed(payload=pa.Payload(mass))}
    if change == UNANNOUNCED:
        return pa.Events(changes=heavier)
    frames = [robot.model.frames[robot.frame_id].placement for robot in (zoo.estimated, zoo.true)]
    tool = (frames[0].inverse() * frames[1]).translation
    told = {"payload": pa.Payload(2.0 * mass, tool)}
    return pa.Events(changes=heavier, announcements={half: told})


def measure(robot: str, reality: str, adaptation: str) -> dict[str, Any]:
    """Return the figures of one run."""
    case = REALITIES[reality]
    zoo = zoo_case(robot, task=case.task)
    true, model, unknown = zoo.true, zoo.estimated, pa.Unknown()
    if case.friction_known:
        unknown = pa.Unknown(friction=False)
    if case.rotors:
        own = np.diag(pin.crba(true.model, true.model.createData(), true.q0))
        rotors = np.maximum(ROTOR[0] * own, ROTOR[1] * own.max())
        true, model = true.changed(armature=rotors), model.changed(armature=rotors)
        unknown = pa.Unknown(armature=False)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of descriptions with unphysical bodies
        controller = pa.make_controller(
            model,
            unknown=unknown,
            sensors=case.sensors,
            dt=case.dt,
            limits=pa.Limits(
                guards={"velocity": False},
                actuators=case.actuators if DECLARED in adaptation else None,
            ),
            **ADAPTATIONS[adaptation],
        )
        rollout = pa.simulate(
            true,
            controller,
            zoo.motion,
            duration=case.duration,
            sensors=case.sensors,
            engine=pa.Engine(torque_limits=zoo.efforts_suffice, actuators=case.actuators),
            events=events(robot, zoo, case.duration / 2.0, case.change),
            record_every=5,
            progress=False,
        )
    t, error = rollout.t, rollout.distance / zoo.radius
    last, lost = t > 0.9 * case.duration, rollout.diverged is not None
    n = true.model.nv
    mass = float(rollout.a_d[-1][: 10 * n : 10].sum()) / true.mass
    second = (t > case.duration / 2 + 0.9) & (t < case.duration / 2 + 1.1)
    found: dict[str, Any] = {
        "error": None if lost else float(error[last].max()),
        "second": None if lost or not case.change else float(error[second].max()),
        "peak": float(error.max()),
        "mass": None if lost else max(mass, 1.0 / mass),
        "chatter": None
        if lost
        else float(np.sqrt(np.mean(np.diff(rollout.tau[last], axis=0) ** 2))),
    }
    if lost:
        found |= {"status": "diverged", "reason": f"at {rollout.diverged:.1f} s"}
    return found


def of_zoo(rows: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return rows of the zoo as rows of this table."""
    found, without = [], {}
    for row in rows:
        case = {"reality": ZOO[row["task"]], "robot": row["robot"]}
        error = None if row["adapted"] is None else row["adapted"] / row["radius"]
        found.append(case | {"adaptation": IN_ZOO[row["adaptation"] or ""], "error": error})
        if row["unadapted"] is not None:
            error = row["unadapted"] / row["radius"]
            without[row["task"], row["robot"]] = case | {"adaptation": "none", "error": error}
    return [*found, *without.values()]


def of_strangers(rows: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return rows of robots of other packages as rows of this table, but for refused ones."""
    found = []
    for row in rows:
        sensors, _, adaptation = row["run"].partition(", ")
        if row["status"] == REFUSED or adaptation not in IN_STRANGERS:
            continue
        case = {"reality": STRANGERS[sensors], "adaptation": IN_STRANGERS[adaptation]}
        error = None if row["error"] is None else row["error"] / row["radius"]
        found.append(case | {"robot": row["robot"], "error": error})
    return found


def whole() -> str:
    """Return the report of the rows of the zoo, of strangers and of this table."""
    elsewhere = [*of_zoo(table_rows("zoo")), *of_strangers(table_rows("strangers"))]
    return report([*elsewhere, *table_rows("adaptations")])


def report(rows: Iterable[Mapping[str, Any]]) -> str:
    """Return a table in Markdown with one line for each reality and adaptation, and its check."""
    rows = list(rows)
    head = [
        "reality",
        "adaptation",
        "robots",
        "median [%]",
        "worst [%]",
        "lost",
        "1 s after the change [%]",
        "mass",
        "peak [%]",
        "chatter",
    ]
    lines = []
    groups: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    for row in rows:
        groups.setdefault((row["reality"], row["adaptation"]), []).append(row)
    for reality, kind in product(CELLS, ADAPTATIONS):
        found = groups.get((reality, kind), [])
        held = [row for row in found if row["error"] is not None]
        if not found:
            continue
        errors = [100.0 * row["error"] for row in held] or [math.nan]
        cells = [
            median(errors),
            max(errors),
            len(found) - len(held),
            100.0 * median(_known(held, "second")),
            max(_known(held, "mass")),
            100.0 * median(_known(found, "peak")),
            median(_known(held, "chatter")),
        ]
        words = ["" if math.isnan(x) else f"{x:.2g}" for x in cells]
        lines.append([reality, kind, str(len(found)), *words])
    text = markdown(head, lines)
    worse = "\n".join(f"- {line}" for line in violations(rows))
    return f"{text}\n\n{WORSE.format(worse) if worse else RIGHT}"


def _known(rows: Iterable[Mapping[str, Any]], key: str) -> list[float]:
    """Return the values that there are, or NaN alone."""
    return [row[key] for row in rows if row.get(key)] or [math.nan]


RIGHT = (
    "By default no reality ends with a median above that of `natural` by more than a tenth or a "
    "worst arm above its worst by more than half, nor with either above that of no adaptation."
)
WORSE = (
    "By default these end with a median above that of `natural` by more than a tenth, a worst arm "
    "above its worst by more than half, or either above that of no adaptation:\n\n{}"
)


def violations(rows: Iterable[Mapping[str, Any]]) -> list[str]:
    """Return one line for each cell in which the memory is worse than it may be."""
    errors: dict[tuple[str, str], dict[str, float]] = {}
    for row in rows:
        error = math.inf if row["error"] is None else 100.0 * row["error"]
        errors.setdefault((row["reality"], row["adaptation"]), {})[row["robot"]] = error
    found = []
    for reality, suffix in product(CELLS, ("", f", {DECLARED}")):
        if reality in REALITIES and REALITIES[reality].friction_known:
            continue  # there "natural" is the default
        own = errors.get((reality, MEMORY + suffix))
        bounds = (
            {"natural": (1.1, 1.5), "none": (1.0, 1.0)}
            if suffix
            else {"natural": (1.1, 1.5), "none, lag 10 ms": (1.0, 1.0), "none": (1.0, 1.0)}
        )
        for kind, (in_median, in_worst) in bounds.items():
            other = errors.get((reality, kind + suffix))
            if not own or not other or own.keys() != other.keys():
                continue
            for name, of, bound in (("median", median, in_median), ("worst", max, in_worst)):
                a, b = of(own.values()), of(other.values())
                if a > bound * b:
                    where = max(own, key=lambda robot: own[robot])
                    found.append(
                        f"{reality}{suffix}: {name} {a:.2g} % for {b:.2g} % of '{kind}' ({where})"
                    )
    return found


def declared(rows: Iterable[Mapping[str, Any]]) -> str:
    """Return a table in Markdown of the errors with actuators that are declared, and not."""
    names = ("none", "natural", MEMORY)
    head, lines = ["", *(each for name in names for each in (f"`{name}`", DECLARED))], []
    errors: dict[str, dict[str, list[float]]] = {}
    for row in rows:
        error = math.inf if row["error"] is None else 100.0 * row["error"]
        errors.setdefault(row["reality"], {}).setdefault(row["adaptation"], []).append(error)
    for reality, found in errors.items():
        own = [found[each] for name in names for each in (name, f"{name}, {DECLARED}")]
        cells = [" / ".join(map(_percent, (median(each), max(each)))) for each in own]
        lines.append([reality, *cells])
    return markdown(head, lines)


def _percent(value: float) -> str:
    return "lost" if math.isinf(value) else two_digits(value)


if __name__ == "__main__":
    print(whole().rpartition("|\n\n")[2])
