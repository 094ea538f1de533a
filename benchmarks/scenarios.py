"""Errors of the scenarios of ``robots/`` with other settings, for tables of several pages.

``make scenarios.table`` runs the sweep ``scenarios.toml`` and writes ``scenarios.csv``: the largest
errors of the last tenth, of the second before each of three times, and after each change of the
robot.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import pinadapt as pa
from pinadapt.scenario import Scenario

from .shared import HERE, Row, diverged, grouped, markdown, two_digits

ROBOTS = HERE.parent / "robots"
_LIFTED = "{mass=3.0,com=[0.0,0.0,0.05]}"
ANNOUNCED = f"events.announcements=[{{at=6.0,payload={{mass=0.0}}}},{{at=12.0,payload={_LIFTED}}}]"


def measure(
    table: str,
    scenario: str,
    run: str = "",
    settings: str = "",
    announced: bool = False,
    engine: str = "",
    adaptation: str = "",
    kinematic: str = "",
) -> dict[str, Any]:
    """Return the errors of a run [m].

    Args:
        table: in which they are shown.
        scenario: file in ``robots``.
        run: words for it.
        settings: "key=value" of the scenario, separated by spaces.
        announced: whether changes of the load are announced.
        engine: of the simulation, other than the file's, as the next two.
        adaptation: of the dynamics.
        kinematic: adaptation of the kinematics.
    """
    named = {
        "engine.plant": engine,
        "controller.adaptation": adaptation,
        "controller.kinematic_adaptation": kinematic,
    }
    given = [*settings.split(), *(f"{key}={value}" for key, value in named.items() if value)]
    given += [ANNOUNCED] * announced
    rollout = Scenario.read(ROBOTS / f"{scenario}.toml", given).run(progress=False)
    if rollout.diverged is not None:
        return {**diverged(rollout), **changes(rollout)}
    found = {"last": digits(rollout.summary()["max_error_last"])}
    for end in ENDS if table == prediction_errors.__name__ else ():
        window = (rollout.t > end - 1.0) & (rollout.t <= end)
        found[f"until_{end:g}s"] = digits(rollout.distance[window].max())
    return {**found, **changes(rollout)}


def changes(rollout: pa.Rollout) -> dict[str, Any]:
    """Return the largest error after each change of the robot [m], and when it is back [s]."""
    events = [each for each in rollout.transients if each.at > 0.0]
    found: dict[str, Any] = {}
    for name, each in zip(("drop", "lift"), events, strict=False):
        found |= {f"{name}.worst": digits(each.max_error), f"{name}.back": each.time_back}
    return found


def digits(value: Any) -> float:
    """Return a number with five digits, as a table keeps it."""
    return float(f"{value:.5g}")


# --- tables ---


def mm(value: float, form: str = "") -> str:
    """Return a length in millimetres, with two digits unless a form is given."""
    return f"{1e3 * value:{form}} mm" if form else f"{two_digits(1e3 * value)} mm"


def words(row: Row) -> dict[str, str]:
    """Return the settings of a row."""
    return dict(each.split("=", 1) for each in (row["settings"] or "").split())


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
    named = words(row)
    law = f"`{named.get('controller.law', 'separation')}`"
    if "sensors.camera" in named:
        return f"{law}, camera of 30 Hz, 60 ms late"
    adaptation = named.get("controller.adaptation")
    return f'{law}, `adaptation = "{adaptation}"`' if adaptation else law


def load_changes(rows: Sequence[Row]) -> str:
    """Return errors after changes of the load, announced and not."""
    lines = []
    for own in grouped(rows, "settings").values():
        line = [law_words(own[0])]
        for row in own:
            for change in ("drop", "lift"):
                back = row[f"{change}.back"]
                when = "never" if back is None else f"{back:.2g} s" if back else "at once"
                if row["status"] != "done" and change == "lift":
                    line.append(f"diverged {row['reason']}")
                else:
                    line.append(f"{mm(row[f'{change}.worst'], '.3g')}, {when}")
        lines.append(line)
    changes = "dropped", "picked up"
    head = [f"{what}, {how}" for how in ("not announced", "announced") for what in changes]
    return markdown(["law", *head], lines)


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
        named = words(row)
        law, kind, regressor = LENGTHS[named.get("controller.law", "")]
        if named and "controller.law" not in named:
            law = "passivity based"
            kind = named.get("controller.adaptation", "gradient")
            nominal = "unknown.regressor" in named
            regressor = "nominal, 60, not covered by the proof" if nominal else ""
            kind = kind if kind == "none" else f"`{kind}`"
        cells.append([law, kind, regressor, mm(row["last"])])
    return markdown(["law", "adaptation", "regressor", "error"], cells)


ENDS = 2.0, 5.0, 10.0  # [s]


def prediction_errors(rows: Sequence[Row]) -> str:
    """Return the errors of the same arm with adaptations to prediction errors, at three times."""
    cells = [
        [f"`{row['adaptation']}`", f"`{row['kinematic']}`"]
        + [mm(row[f"until_{end:g}s"], ".3f") for end in ENDS]
        for row in rows
    ]
    head = ["`adaptation`", "`kinematic_adaptation`", *(f"{end:g} s" for end in ENDS)]
    return markdown(head, cells)


def of_table(report: Callable[[list[Row]], str]) -> Callable[[Sequence[Row]], str]:
    """Return a report of the rows of its own table."""
    return lambda rows: report([row for row in rows if row["table"] == report.__name__])


TABLES = {
    report.__name__: of_table(report)
    for report in (engines, load_changes, unknown_lengths, prediction_errors)
}
