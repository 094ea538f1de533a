"""Errors of the scenarios of ``robots/`` with other settings, for tables of several pages.

``make scenarios.table`` runs the sweep ``scenarios.toml`` and writes ``scenarios.csv``: the largest
errors of each half second, of the last tenth, and of the time after each change of the robot, and
where a tool is unknown, how far its estimate is from the truth.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

import pinadapt as pa
from pinadapt.cli.compare import SHOWCASE
from pinadapt.scenario import Scenario

from .timing import HERE, markdown, two_digits

ROBOTS = HERE.parent / "robots"
ANNOUNCED = (
    "belief.change=[{at=6.0,payload={mass=0.0}},{at=12.0,payload={mass=3.0,com=[0.0,0.0,0.05]}}]"
)
NATURAL = "controller.adaptation=natural"
TIMES = (0.3, 1.0, 5.0, 10.0)  # [s] of the errors of a tool
DROP, LIFT = 6.0, 12.0  # [s] changes of the load in panda/load_changes.toml
Row = Mapping[str, Any]


def measure(
    table: str,
    scenario: str,
    run: str = "",
    settings: str = "",
    announced: bool = False,
    encoder: float = 0.0,
    robot: str = "",
    engine: str = "",
    adaptation: str = "",
    kinematic: str = "",
) -> dict[str, Any]:
    """Return the errors of a run [m].

    Args:
        table: in which they are shown.
        scenario: file in ``robots``, or a run of ``pinadapt demo``.
        run: words for it.
        settings: "key=value" of the scenario, separated by spaces.
        announced: whether changes of the load are announced.
        encoder: resolution [rad].
        robot: other than the file's, as the next three.
        engine: of the simulation.
        adaptation: of the dynamics.
        kinematic: adaptation of the kinematics.
    """
    named = {
        "robot.source": robot,
        "simulation.engine": engine,
        "controller.adaptation": adaptation,
        "controller.kinematic_adaptation": kinematic,
    }
    given = [*settings.split(), *(f"{key}={value}" for key, value in named.items() if value)]
    given += [ANNOUNCED] * announced + [f"simulation.encoder={encoder}"] * (encoder > 0.0)
    shown = {name: (file, own) for name, file, own in SHOWCASE}
    file, own = shown.get(scenario, (f"{scenario}.toml", ()))
    found = Scenario.read(ROBOTS / file, [*own, *given])
    rollout = found.run(progress=False)
    if rollout.diverged is not None:
        words = f"at {rollout.diverged:.1f} s"
        return {"status": "diverged", "reason": words, **changes(rollout)}
    halves = np.floor(2.0 * (rollout.t - 1e-9)).clip(0).astype(int)
    worst = [rollout.distance[halves == k].max() for k in range(halves[-1] + 1)]
    last = rollout.distance[rollout.t > rollout.t[-1] - 1.0]
    return {
        "last": digits(rollout.summary()["max_error_last"]),
        "rms": digits(np.sqrt(np.mean(last**2))),
        "half": [digits(each) for each in worst],
        **changes(rollout),
        **tools(rollout, found),
    }


def changes(rollout: pa.Rollout) -> dict[str, Any]:
    """Return the largest error after each change of the robot [m], and when it is back [s]."""
    events = [each for each in rollout.transients if each.at > 0.0]
    found: dict[str, Any] = {}
    for name, each in zip(("drop", "lift"), events, strict=False):
        found |= {f"{name}.worst": digits(each.worst), f"{name}.back": each.back}
    return found


def tools(rollout: pa.Rollout, scenario: Scenario) -> dict[str, Any]:
    """Return the error of the estimated tool at some times [m]; none where it is known."""
    names = scenario.controller.kinematics.names
    index = [i for i, name in enumerate(names) if name.startswith("tool_")]
    truth = scenario.controller.kinematics.value(scenario.true)
    if not index or truth is None or rollout.t[-1] < 0.99 * TIMES[-1]:
        return {}
    when = [min(int(np.searchsorted(rollout.t, t)), len(rollout.t) - 1) for t in TIMES]
    away = rollout.a_k[when][:, index] - truth[index]
    return {"tool": [digits(each) for each in np.linalg.norm(away, axis=1)]}


def digits(value: Any) -> float:
    """Return a number with five digits, as a table keeps it."""
    return float(f"{value:.5g}")


# --- tables ---


def mm(value: float | None, form: str = "") -> str:
    """Return a length in millimetres, with two digits unless a form is given."""
    if value is None:
        return "lost"
    return f"{1e3 * value:{form}} mm" if form else f"{two_digits(1e3 * value)} mm"


def window(row: Row, begin: float, end: float) -> float:
    """Return the largest error between two times, which are whole half seconds [m]."""
    return max(row[f"half[{k}]"] for k in range(round(2.0 * begin), round(2.0 * end)))


DEMO = {
    "planar_known": ("planar arm, known, resolved acceleration", "error of sampling alone"),
    "planar_improved": (
        "planar arm, improved law, published gains",
        "M̂ becomes indefinite; this law does not invert it",
    ),
    "planar_passivity_based": ("planar arm, passivity based, published gains", ""),
    "panda_unadapted": (
        "Panda, unknown tool, load of 1.5 kg and friction, inertias 30 % too small, x at 30 Hz "
        "with 60 ms delay, without adaptation",
        "",
    ),
    "panda_adaptive": (
        "Panda, the same, with tool, 70 inertial parameters and friction adapted",
        "M̂ ≻ 0 throughout",
    ),
}


def demo(rows: Sequence[Row]) -> str:
    """Return the runs of `make demo`."""
    cells = [[DEMO[r["scenario"]][0], mm(r["last"]), DEMO[r["scenario"]][1]] for r in rows]
    return markdown(["run", "error", "remark"], cells)


def engines(rows: Sequence[Row]) -> str:
    """Return the errors of scenarios in two engines, and with hidden friction and rotors."""
    found = {(r["scenario"], r["engine"], r["run"] or ""): mm(r["last"], "#.3g") for r in rows}
    columns = [("pinocchio", ""), ("mujoco", ""), ("mujoco", "hidden")]
    names = dict.fromkeys(r["scenario"] for r in rows)
    cells = [
        [f"`{name}`", *(found[name, engine, run] for engine, run in columns)] for name in names
    ]
    return markdown(["scenario", "Pinocchio", "MuJoCo", "MuJoCo, hidden"], cells)


def law_words(row: Row) -> str:
    """Return law and adaptation that settings name."""
    words = dict(each.split("=", 1) for each in (row["settings"] or "").split())
    law = f"`{words.get('controller.law', 'separation')}`"
    if "simulation.camera" in words:
        return f"{law}, camera of 30 Hz, 60 ms late"
    adaptation = words.get("controller.adaptation")
    return f'{law}, `adaptation = "{adaptation}"`' if adaptation else law


def load_changes(rows: Sequence[Row]) -> str:
    """Return errors after changes of the load, announced and not."""
    found: dict[str, list[str]] = {}
    for row in rows:
        for change in ("drop", "lift"):
            worst, back = row[f"{change}.worst"], row[f"{change}.back"]
            when = "never" if back is None else f"{back:.2g} s" if back else "at once"
            lost = row["status"] != "done" and change == "lift"
            words = f"diverged {row['reason']}" if lost else f"{mm(worst, '.3g')}, {when}"
            found.setdefault(law_words(row), []).append(words)
    head = [f"{what}, {how}" for how in ("not announced", "announced") for what in CHANGES]
    return markdown(["law", *head], [[name, *cells] for name, cells in found.items()])


CHANGES = ("dropped", "picked up")


def after_changes(rows: Sequence[Row]) -> str:
    """Return the errors around changes of the load, without and with a memory."""
    chosen = [row for row in rows if (row["settings"] or NATURAL) == NATURAL]
    windows = {
        "in the second before": (DROP - 1.0, DROP),
        "0.5 s after the drop": (DROP, DROP + 0.5),
        "1 to 2 s": (DROP + 1.0, DROP + 2.0),
        "3 to 4 s": (DROP + 3.0, DROP + 4.0),
        "0.5 s after the new load": (LIFT, LIFT + 0.5),
        "1 to 2 s ": (LIFT + 1.0, LIFT + 2.0),
        "3 to 6 s": (LIFT + 3.0, LIFT + 6.0),
    }
    cells = []
    for row in sorted(chosen, key=lambda row: row["announced"]):
        name = f"`{'natural' if row['settings'] else 'natural-memory'}`"
        numbers = [two_digits(1e3 * window(row, *each)) for each in windows.values()]
        cells.append([name + ", announced" * bool(row["announced"]), *numbers])
    return markdown(["largest error [mm]", *(name.strip() for name in windows)], cells)


LENGTHS = {
    "": ("passivity based, as in the file", "`gradient`", "exact, 56"),
    "separation": ("the default, `separation`, with 18 joint coefficients", "`gradient`",
                   "exact, 56"),
    "adaptive-inverse-dynamics-improved": ("improved", "`gradient`", "exact, 56"),
    "adaptive-inverse-dynamics": ("adaptive inverse dynamics (11)", "`projected`", "exact, 56"),
    "adaptive-inverse-dynamics-velocity": ("with task velocity (25)", "`projected`", "exact, 56"),
}  # fmt: skip


def unknown_lengths(rows: Sequence[Row]) -> str:
    """Return the errors of an arm whose lengths are unknown, by law and adaptation."""
    cells = []
    for row in rows:
        words = dict(each.split("=", 1) for each in (row["settings"] or "").split())
        law, kind, regressor = LENGTHS[words.get("controller.law", "")]
        if row["settings"] and "controller.law" not in words:
            law, kind = "passivity based", words.get("controller.adaptation", "gradient")
            nominal = "unknown.regressor" in words
            regressor = "nominal, 60, not covered by the proof" if nominal else ""
            kind = kind if kind == "none" else f"`{kind}`"
        cells.append([law, kind, regressor, mm(row["last"])])
    return markdown(["law", "adaptation", "regressor", "error"], cells)


def prediction_errors(rows: Sequence[Row]) -> str:
    """Return the errors of the same arm with adaptations to prediction errors, at three times."""
    cells = [
        [f"`{row['adaptation']}`", f"`{row['kinematic']}`"]
        + [mm(window(row, end - 1.0, end), ".3f") for end in (2.0, 5.0, 10.0)]
        for row in rows
    ]
    return markdown(["`adaptation`", "`kinematic_adaptation`", "2 s", "5 s", "10 s"], cells)


def torques(rows: Sequence[Row]) -> str:
    """Return errors on a circle by what an adaptation learns from, with and without encoders."""
    found = {
        (row["encoder"] > 0.0, row["adaptation"], row["robot"]): window(row, 6.5, 8.0)
        for row in rows
    }
    kinds, robots = (
        list(dict.fromkeys(row[key] for row in rows)) for key in ("adaptation", "robot")
    )
    cells = [
        [f"`{kind}`", *(mm(found[False, kind, name], ".3f") for name in robots)] for kind in kinds
    ]
    coarse = [
        ", ".join(f"{1e3 * found[True, kind, name]:.2f}" for kind in kinds) for name in robots
    ]
    cells.append(
        ["the same three with an encoder of 17 bits a turn", *(f"{each} mm" for each in coarse)]
    )
    return markdown([TORQUES, "Panda", "UR5"], cells)


TORQUES = (
    "default law, circle of 0.1 m, tool, 1 kg, friction and 20 % of all inertias unknown, largest "
    "error from 6.5 to 8 s"
)


def encoders(rows: Sequence[Row]) -> str:
    """Return errors with encoders of 17 bits, with and without a camera."""
    columns = {
        (robot, file): f"{words}{', camera of 30 Hz, 60 ms late' * (file == 'panda/tool_and_load')}"
        for robot, words in (("panda", "Panda"), ("ur5", "UR5"))
        for file in ("panda/load_changes", "panda/tool_and_load")
    }
    found = {(r["adaptation"], r["robot"], r["scenario"]): mm(r["last"]) for r in rows}
    cells = [
        [f"`{kind}`", *(found[kind, robot, file] for robot, file in columns)]
        for kind in dict.fromkeys(row["adaptation"] for row in rows)
    ]
    return markdown(["", *columns.values()], cells)


def kinematics(rows: Sequence[Row]) -> str:
    """Return the errors of the tool by the adaptation of the kinematics."""
    cells = []
    for row in rows:
        words = "Panda"
        if "camera" in row["settings"]:
            words = "30 frames a second, 60 ms late, 1 mm of noise"
            words += ", base unknown too" * ('"base"' in row["settings"])
        errors = [
            mm(row[f"tool[{k}]"]) if row[f"tool[{k}]"] > 1e-7 else "below 1e-4 mm" for k in range(4)
        ]
        cells.append([f"{words}, `{row['kinematic']}`", *errors, mm(row["rms"])])
    head = [f"after {TIMES[0]} s", *(f"{t:g} s" for t in TIMES[1:])]
    return markdown([KINEMATICS, *head, "tracking error, rms of the last second"], cells)


KINEMATICS = (
    "default law, circle of 0.1 m, tool, 1 kg and 20 % of all inertias unknown: error of the tool"
)
TABLES: dict[str, Callable[[Sequence[Row]], str]] = {
    report.__name__: report
    for report in (
        demo,
        engines,
        load_changes,
        unknown_lengths,
        prediction_errors,
        torques,
        encoders,
        kinematics,
    )
}
