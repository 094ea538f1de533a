"""Errors of the scenarios of ``robots/`` with other settings, for tables of several pages.

``make scenarios.table`` runs the sweep ``scenarios.toml`` and writes ``scenarios.csv``: the largest
errors of each half second, of the last tenth, and of the time after each change of the robot.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

import pinadapt as pa
from pinadapt.scenario import Scenario

from .timing import HERE, markdown, two_digits

ROBOTS = HERE.parent / "robots"
_LIFTED = "{mass=3.0,com=[0.0,0.0,0.05]}"
ANNOUNCED = f"events.announcements=[{{at=6.0,payload={{mass=0.0}}}},{{at=12.0,payload={_LIFTED}}}]"
Row = Mapping[str, Any]


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
    found = Scenario.read(ROBOTS / f"{scenario}.toml", given)
    rollout = found.run(progress=False)
    if rollout.diverged is not None:
        words = f"at {rollout.diverged:.1f} s"
        return {"status": "diverged", "reason": words, **changes(rollout)}
    halves = np.floor(2.0 * (rollout.t - 1e-9)).clip(0).astype(int)
    worst = [rollout.distance[halves == k].max() for k in range(halves[-1] + 1)]
    return {
        "last": digits(rollout.summary()["max_error_last"]),
        "half": [digits(each) for each in worst],
        **changes(rollout),
    }


def changes(rollout: pa.Rollout) -> dict[str, Any]:
    """Return the largest error after each change of the robot [m], and when it is back [s]."""
    events = [each for each in rollout.transients if each.at > 0.0]
    found: dict[str, Any] = {}
    for name, each in zip(("drop", "lift"), events, strict=False):
        found |= {f"{name}.worst": digits(each.worst), f"{name}.back": each.back}
    return found


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
    if "sensors.camera" in words:
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


TABLES: dict[str, Callable[[Sequence[Row]], str]] = {
    report.__name__: report
    for report in (engines, load_changes, unknown_lengths, prediction_errors)
}
