"""What runs identify of bodies, loads and joints: tables of the pages on learning and on laws.

``make learned.table`` runs the sweep ``learned.toml`` and writes ``learned.csv``. In all of it the
inertias of a model are too small, and tool, load and friction are unknown; the errors of a learned
robot are those of its torques along a motion that it was not learned from, sinusoids of all joints
by half a radian for 10 s, with periods from 3 s at the first joint to 6 s at the last.
"""

from __future__ import annotations

import re
import tempfile
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

import pinadapt as pa

from .timing import markdown

LOAD, TOOL = pa.Payload(1.5, (0.02, -0.01, 0.05)), (0.03, -0.02, 0.12)
LIGHTER = 0.7
FRICTION: dict[str, dict[str, Any]] = {
    "none": {},
    "0.3 N m s/rad, 0.5 N m dry": {"viscous": 0.3, "coulomb": 0.5},
}
ALL = pa.Unknown(friction=True, armature=True)
BODIES = pa.Unknown(friction=False, armature=False)
SHARES = (0.1, 0.08, 0.06, 0.05)  # of the torque, below which its error falls
EVERY, SWING = 20, 0.5  # samples between errors of the torques; [rad] of the sinusoids
Row = Mapping[str, Any]


def torque(robot: pa.Robot) -> Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]:
    """Return the torque of a robot as a function of q, v and acceleration."""
    dynamics = pa.make_controller(robot, unknown=ALL).dynamics
    value = dynamics.value(robot)
    assert value is not None
    dynamics.load(value)
    return dynamics.torque


def sinusoids(robot: pa.Robot) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Return q, v and acceleration along 10 s of sinusoids of all joints."""
    n = robot.model.nv
    motion = pa.trajectories.Sinusoid(np.zeros(n), SWING, np.linspace(3.0, 6.0, n), phase=0.0)
    points = [motion.at(t) for t in np.arange(0.0, 10.0, 0.02)]
    return [(robot.q0 + each.x_d, each.xd_d, each.xdd_d) for each in points]


def along(run: pa.Rollout) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Return q, v and acceleration along a run."""
    acceleration = np.gradient(run.v, run.t, axis=0)
    return list(zip(run.q[::EVERY], run.v[::EVERY], acceleration[::EVERY], strict=True))


def torque_error(
    robot: pa.Robot, true: pa.Robot, motion: Iterable[tuple[np.ndarray, np.ndarray, np.ndarray]]
) -> float:
    """Return the rms error of the torques that a robot predicts for a motion [N m]."""
    found, exact = torque(robot), torque(true)
    errors = [found(*point).copy() - exact(*point) for point in motion]
    return float(np.sqrt(np.mean(np.square(errors))))


def tool_error(robot: pa.Robot, true: pa.Robot) -> float:
    """Return how far the frame is from where the true one is at home [m]."""
    return float(np.linalg.norm(robot.position(true.q0) - true.position(true.q0)))


def kept(robot: str, adaptation: str, encoder: float = 0.0) -> dict[str, Any]:
    """Return the estimates after a circle: all of them, and only the excited ones."""
    described = pa.load(robot)
    true = described.changed(payload=LOAD, tool_translation=TOOL)
    model = described.changed(inertial_scale=LIGHTER)
    sensors = pa.Sensors(encoder=encoder) if encoder else None
    controller = pa.make_controller(model, adaptation=adaptation, sensors=sensors)
    run = pa.simulate(true, controller, pa.reachable_circle(true), duration=10.0)
    ideal = pa.simulate(
        true, pa.make_controller(true, adaptation="none"), pa.reachable_circle(true), duration=10.0
    )
    found: dict[str, Any] = {}
    for name, whole in (("as estimated", True), ("where excited", False)):
        learned = run.learned(all_estimates=whole)
        bodies = zip(learned.model.inertias[1:], model.model.inertias[1:], strict=True)
        found[name] = {
            "mass": max(body.mass / before.mass for body, before in bodies),
            "circle": torque_error(learned, true, along(ideal)),
            "sinusoids": torque_error(learned, true, sinusoids(true)),
        }
    return found


def path_of(motion: str, true: pa.Robot) -> tuple[pa.trajectories.Trajectory, float]:
    """Return a circle or a Lissajous figure and the duration [s] from words."""
    duration = float(re.findall(r", (\d+) s", motion)[-1])
    if motion.startswith("circle"):
        return pa.reachable_circle(true), duration
    period = float(re.findall(r"in (\d+) s", motion)[0])
    home = true.position(true.q0)
    return pa.trajectories.Lissajous(home, [0.12, 0.2, 0.12], [3, 4, 5], period), duration


def motions(motion: str, adaptation: str, joints: bool) -> dict[str, Any]:
    """Return how well the URDF learned from a motion predicts torques and places the tool."""
    described = pa.load("panda")
    true = described.changed(payload=LOAD, tool_translation=TOOL)
    model = described.changed(inertial_scale=LIGHTER)
    unknown = ALL if joints else BODIES
    path, duration = path_of(motion, true)
    controller = pa.make_controller(model, adaptation=adaptation, unknown=unknown)
    learned = saved_and_loaded(pa.simulate(true, controller, path, duration=duration).learned())
    return {
        "before": torque_error(model, true, sinusoids(true)),
        "after": torque_error(learned, true, sinusoids(true)),
        "tool": tool_error(learned, true),
    }


def saved_and_loaded(robot: pa.Robot) -> pa.Robot:
    """Return a robot after it was written as a URDF."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "learned.urdf"
        robot.save(path, shapes=False)
        return pa.load(path, frame=robot.frame, joint_effects=True, q0=robot.q0)


def load(motion: str) -> dict[str, Any]:
    """Return the load, from the last estimates and from all data."""
    panda = pa.load("panda")
    unknown = pa.Unknown(bodies="payload", friction=False, armature=False)
    path, duration = path_of(motion, panda)
    controller = pa.make_controller(panda, unknown=unknown)
    run = pa.simulate(panda.changed(payload=LOAD), controller, path, duration=duration)
    found: dict[str, Any] = {}
    for name, refined in (("last", False), ("refined", True)):
        one = run.payload(refined=refined)
        found[name] = {
            "mass": one.mass,
            "mass_known_to": one.mass_known_to,
            "com": 1e3 * one.com,
            "com_known_to": 1e3 * one.com_known_to,
        }
    return found


def explained(truth: str) -> dict[str, Any]:
    """Return the estimate of a load, and the other explanations."""
    panda = pa.load("panda")
    true, model, unknown = panda, panda, pa.Unknown()
    if truth.startswith("1.5 kg"):
        true = panda.changed(payload=LOAD)
    if "30 % up" in truth or truth.startswith("the same"):
        true = panda.changed(inertial_scale=1.3)
    if truth.startswith("the same"):
        unknown = pa.Unknown(bodies="payload")
    if "70 %" in truth:
        model = panda.changed(inertial_scale=LIGHTER)
    if "link 4" in truth:
        true = panda.changed(inertial_scale={"panda_joint4": 1.5})
    controller = pa.make_controller(model, unknown=unknown, dt=2e-3)
    run = pa.simulate(true, controller, pa.reachable_circle(true), duration=10.0)
    one = run.payload(refined=True)
    first = one.explanations[0]
    return {
        "mass": one.mass,
        "mass_known_to": one.mass_known_to,
        "certain": bool(one.certain),
        "explained": one.explained,
        "words": first.words,
        "first_mass": float(first.load[0]) if first.loaded else None,
    }


@lru_cache(maxsize=1)
def exciting() -> pa.excitation.ExcitingMotion:
    """Return ten seconds of a motion that excites all parameters of a Panda."""
    return pa.excite(pa.load("panda"), duration=10.0)


def friction(adaptation: str, friction: str) -> dict[str, Any]:
    """Return how well a robot predicts torques that was learned with both sensors."""
    options = FRICTION[friction]
    described = pa.load("panda")
    true = described.changed(payload=LOAD, tool_translation=TOOL, **options)
    joint = pa.load("panda", task="joint")
    moved = joint.changed(payload=LOAD, tool_translation=TOOL, **options)
    model = joint.changed(inertial_scale=LIGHTER)
    controller = pa.make_controller(model, adaptation=adaptation, unknown=ALL)
    motion = exciting()
    run = pa.simulate(moved, controller, motion.trajectory, duration=motion.duration)
    first = saved_and_loaded(run.learned())
    controller = pa.make_controller(first, adaptation=adaptation, unknown=ALL)
    circle = pa.simulate(true, controller, pa.reachable_circle(true), duration=5.0)
    second = circle.learned()
    return {
        "before": torque_error(described.changed(inertial_scale=LIGHTER), true, sinusoids(true)),
        "excited": torque_error(first, true, sinusoids(true)),
        "circle": torque_error(second, true, sinusoids(true)),
        "tool": tool_error(second, true),
    }


def identifiable(adaptation: str) -> dict[str, Any]:
    """Return what the motion of a run identifies, by its summary."""
    panda = pa.load("panda")
    true = panda.changed(payload=LOAD, tool_translation=TOOL)
    controller = pa.make_controller(panda.changed(inertial_scale=LIGHTER), adaptation=adaptation)
    run = pa.simulate(true, controller, pa.reachable_circle(true), duration=10.0)
    found = dict(run.summary()["torque_prediction"])
    names = found.pop("not_excited")
    return found | {"parameters": controller.dynamics.size, "not_excited": len(names)}


def excited(adaptation: str, friction: str) -> dict[str, Any]:
    """Return when the error of the torques at random states falls below shares of the torque."""
    joint = pa.load("panda", task="joint")
    true = joint.changed(payload=LOAD, **FRICTION[friction])
    unknown = ALL if FRICTION[friction] else BODIES
    controller = pa.make_controller(
        joint.changed(inertial_scale=0.8), law="slotine-li", adaptation=adaptation, unknown=unknown
    )
    motion = exciting()
    run = pa.simulate(
        true, controller, motion.trajectory, duration=motion.duration, record_every=EVERY
    )
    rng, exact = np.random.default_rng(1), torque(true)
    states = [
        (joint.q0 + 0.5 * rng.standard_normal(7), *rng.standard_normal((2, 7)) * [[1.0], [3.0]])
        for _ in range(100)
    ]
    wanted = np.array([exact(*state).copy() for state in states])
    size, dynamics, errors = np.sqrt(np.mean(wanted**2)), controller.dynamics, []
    for estimate in run.a_d:
        dynamics.load(estimate)
        off = [dynamics.torque(*state) - tau for state, tau in zip(states, wanted, strict=True)]
        errors.append(np.sqrt(np.mean(np.square(off))) / size)
    found: dict[str, Any] = {"first": errors[0], "last": errors[-1]}
    for share in SHARES:
        above = np.flatnonzero(np.array(errors) >= share)
        stays = above.size and above[-1] + 1 < len(errors)
        found[f"below {share:.0%}"] = float(run.t[above[-1] + 1]) if stays else None
    return found


RUNS: dict[str, Callable[..., dict[str, Any]]] = {
    "kept": kept,
    "motions": motions,
    "load": load,
    "explained": explained,
    "friction": friction,
    "identifiable": identifiable,
    "exciting": excited,
}


def measure(
    table: str,
    robot: str = "",
    adaptation: str = "",
    encoder: float = 0.0,
    joints: bool = True,
    motion: str = "",
    truth: str = "",
    friction: str = "",
) -> dict[str, Any]:
    """Return the numbers of a row of a table; see the function of its name."""
    given = {
        "robot": robot,
        "adaptation": adaptation,
        "encoder": encoder,
        "motion": motion,
        "truth": truth,
        "friction": friction,
    }
    named = {key: value for key, value in given.items() if value}
    if table == "motions":
        named["joints"] = joints
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of light joints, and of what a description leaves out
        return RUNS[table](**named)


# --- tables ---


def short(value: float) -> str:
    """Return a number with two digits, and no exponent."""
    return f"{value:.0f}" if value >= 10.0 else f"{value:.2g}"


def kept_table(rows: Sequence[Row]) -> str:
    """Return what is kept where a motion did not excite it."""
    cells = []
    for row in rows:
        sensors = ", encoders of 17 bits" if row["encoder"] else ""
        for name in ("as estimated", "where excited"):
            words = f"{row['robot']}, `{row['adaptation']}`{sensors}, {name}"
            mass, circle, other = (row[f"{name}.{key}"] for key in ("mass", "circle", "sinusoids"))
            cells.append([words, short(mass), f"{circle:.2g} N m", f"{other:.2g} N m"])
    head = ["", "largest mass over the model's", "torques of the circle"]
    return markdown([*head, "of the sinusoids below"], cells)


def less(before: float, after: float) -> str:
    """Return an error of torques, and how much less it is than before."""
    return f"{after:.2g} N m, {short(before / after)} times less"


def motions_table(rows: Sequence[Row]) -> str:
    """Return the results of different motions."""
    cells = [
        [
            row["motion"],
            f"bodies, tool{' and joints' * bool(row['joints'])}, `{row['adaptation']}`",
            less(row["before"], row["after"]),
            "below 1e-6 mm" if row["tool"] < 1e-9 else f"{1e3 * row['tool']:.2g} mm",
        ]
        for row in rows
    ]
    return markdown(["motion", "adapted", "error of the torques", "error of the tool"], cells)


def load_table(rows: Sequence[Row]) -> str:
    """Return the load from the last estimates and from all data."""
    (row,), cells = rows, []
    for name, words in (("last", "last estimates"), ("refined", "`refined`")):
        mass, known = (row[f"{name}.{key}"] for key in ("mass", "mass_known_to"))
        com, off = (
            [row[f"{name}.{key}[{k}]"] for k in range(3)] for key in ("com", "com_known_to")
        )
        exact = known < 1e-4
        places = 4 if exact else max(0, int(np.ceil(-np.log10(known))))
        centre = [
            f"{x:.2f}" if exact else f"{x:.0f} ± {short(each)}"
            for x, each in zip(com, off, strict=True)
        ]
        cells.append(
            [
                words,
                f"{mass:.{places}f}{'' if exact else f' ± {known:.1g}'} kg",
                f"{', '.join(centre)} mm",
            ]
        )
    return markdown(["", "mass", "centre"], cells)


def explained_table(rows: Sequence[Row]) -> str:
    """Return estimates of loads, and the most probable explanations."""
    cells = []
    for row in rows:
        mass, known = row["mass"], row["mass_known_to"]
        words = (
            f"{mass:.4f} kg ± {1e6 * known:.1g} mg"
            if known < 1e-3
            else f"{mass:.2g} ± {known:.2g} kg"
        )
        most = row["words"]
        if row["first_mass"] is not None:
            most += f" of {row['first_mass']:.3f} kg"
        cells.append(
            [
                row["truth"],
                words + ", **not certain**" * (not row["certain"]),
                f"{100.0 * row['explained']:.3g} %",
                most,
            ]
        )
    return markdown(["truth", "estimate of the load", "it explains", "most probable"], cells)


def friction_table(rows: Sequence[Row]) -> str:
    """Return the results of an exciting motion and a circle, with and without friction."""
    cells = [
        [
            f"`{row['adaptation']}`",
            row["friction"],
            less(row["before"], row["excited"]),
            less(row["before"], row["circle"]),
        ]
        for row in rows
    ]
    head = ["adaptation", "friction of each joint", "error after the exciting motion"]
    return markdown([*head, "after the circle too"], cells)


def identifiable_table(rows: Sequence[Row]) -> str:
    """Return what the motion of a run identifies."""
    torques = [
        f"{row['error_first']:.2g} → {row['error_last']:.3g} N m, "
        f"{100.0 * row['share_first']:.2g} % → {100.0 * row['share_last']:.2g} % of the torque"
        for row in rows
    ]
    known = [
        f"{row['identifiable']:.0f} combinations of {row['parameters']:.0f} parameters, error "
        f"{100.0 * row['identifiable_error']:.2g} % of the start"
        for row in rows
    ]
    cells = [
        ["predicted torque (rms error)", *torques],
        ["identifiable by this motion", *known],
        ["not excited by this motion", *(f"{row['not_excited']:.0f} parameters" for row in rows)],
    ]
    return markdown(["", *(f"`{row['adaptation']}`" for row in rows)], cells)


def exciting_table(rows: Sequence[Row]) -> str:
    """Return how soon torques are predicted in an exciting motion."""
    cells = []
    for row in rows:
        times = [row[f"below {share:.0%}"] for share in SHARES]
        words = "" if row["friction"] == "none" else ", friction unknown"
        shown = ["not in 10 s" if t is None else f"{t:.2f} s" for t in times]
        cells.append([f"`{row['adaptation']}`{words}", *shown])
    head = [f"below {share:.0%}".replace("%", " %") for share in SHARES]
    return markdown(
        [EXCITING, *head[:1], *(each.removeprefix("below ") for each in head[1:])], cells
    )


EXCITING = (
    "Panda, Slotine and Li's law, 1.5 kg and 20 % of all inertias unknown, exciting motion: error "
    "of the torques at random states"
)
TABLES = {
    "kept": kept_table,
    "motions": motions_table,
    "load": load_table,
    "explained": explained_table,
    "friction": friction_table,
    "identifiable": identifiable_table,
    "exciting": exciting_table,
}
