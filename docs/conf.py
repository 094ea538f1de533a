"""The site: `make docs` builds it into build/site, with warnings as errors."""

import json
import math
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "docs" / "_ext"))

from pinadapt import __version__  # noqa: E402  after the path
from pinadapt.sweep import CaseTable  # noqa: E402

project = "pinadapt"
author = "The pinadapt developers"
project_copyright = "2026, the pinadapt developers"
version = release = __version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.mathjax",
    "sphinx-mathjax-offline",
    "rooms",
    "docstrings",
    "links",
    "executed",
]
source_suffix = {".rst": "restructuredtext", ".md": "myst-nb", ".ipynb": "myst-nb"}
exclude_patterns = ["_ext", "robots/README.md"]

html_theme = "furo"
html_title = f"pinadapt {version}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_favicon = "_static/icon.svg"
html_copy_source = False
html_show_sourcelink = False

myst_enable_extensions = ["amsmath", "dollarmath", "substitution"]
myst_heading_anchors = 3
math_numfig = False

# Notebooks are stored without outputs. Those that the tests have run are shown with these outputs,
# see _ext/executed.py; others are run here, in their folder.
nb_execution_mode = "auto"
nb_execution_excludepatterns = [] if find_spec("pylibfranka") else ["*11_behind_a_protocol*"]
nb_execution_timeout = 600
nb_execution_raise_on_error = True
nb_ipywidgets_js = {}  # no requests to other hosts

autodoc_member_order = "bysource"
toc_object_entries_show_parents = "hide"
autodoc_typehints_format = "short"
python_maximum_signature_line_length = 88
napoleon_numpy_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False


def law_figures() -> dict[str, dict[str, str]]:
    """Return the figures of `python -m benchmarks.laws` for each law, as text."""
    rows = json.loads((ROOT / "benchmarks" / "laws.json").read_text())["rows"]
    return {
        row["name"]: {
            "error": error_text(row["error"], row["unit"]),
            "camera": error_text(row["error_camera"], row["unit"]),
            "cost": f"{row['step_ratio']:.0f}",
        }
        for row in rows
    }


def error_text(error: float | None, unit: str) -> str:
    """Return an error in mm or degrees, without line breaks."""
    if error is None:
        return "lost"
    return (
        f"{1e3 * error:.2g}\N{NO-BREAK SPACE}mm" if unit == "m" else f"{math.degrees(error):.2g}°"
    )


def swept(name: str) -> list[dict[str, Any]]:
    """Return the rows of a sweep of the benchmarks, in order: `make NAME.table` measures them."""
    return list(CaseTable.load(ROOT / "benchmarks" / f"{name}.csv").rows())


def modification_table() -> str:
    """Return the table of modifications, by robot and modification."""
    rows = swept("modifications")
    columns = list(dict.fromkeys(row["disturbance"] for row in rows))
    cells = {(row["robot"], row["modification"], row["disturbance"]): modified(row) for row in rows}
    lines = ["| | " + " | ".join(columns) + " |", "|---" * (len(columns) + 1) + "|"]
    for robot, kind in dict.fromkeys((row["robot"], row["modification"]) for row in rows):
        own = [cells.get((robot, kind, column), "") for column in columns]
        lines.append(f"| {robot}, {kind} | " + " | ".join(own) + " |")
    return "\n".join(lines)


def modified(row: dict[str, Any]) -> str:
    """Return error and drift of a run; nothing where the modification does not fit the law."""
    if row["status"] != "done":
        return "" if row["status"] == "refused" else f"lost {row['reason']}"
    drift = "unphysical" if row["factor"] is None else f"{row['factor']:.3g}"
    return f"{row['error_mm']:.2g}\N{NO-BREAK SPACE}mm, {drift}"


def sensor_table() -> str:
    """Return the table of sensors, by robot."""
    rows = swept("sensors")
    columns = list(dict.fromkeys(row["sensors"] for row in rows))
    lines = ["| | " + " | ".join(columns) + " |", "|---" * (len(columns) + 1) + "|"]
    for robot in dict.fromkeys(row["robot"] for row in rows):
        own = [
            f"{row['rms_mm']:.2f} / {row['max_mm']:.2f}" if row["status"] == "done" else "lost"
            for row in rows
            if row["robot"] == robot
        ]
        lines.append(f"| {robot} | " + " | ".join(own) + " |")
    return "\n".join(lines)


def tuned_table() -> str:
    """Return what `pinadapt tune` found for each law, on other seeds than it searched with."""
    lines = [
        '| law | defaults | gains found | verdicts "follows" | gains |',
        "|---|---|---|---|---|",
    ]
    for law in ("separation", "adaptive-inverse-dynamics", "adaptive-jacobian"):
        found = json.loads((ROOT / "benchmarks" / "tuned" / f"{law}.json").read_text())
        default, best = (100.0 * found["validation"][key] for key in ("default", "best"))
        follows = " and ".join(
            f"{found['success'][key]['good']} of {found['success'][key]['total']}"
            for key in ("default", "best")
        )
        words = "**better**" if found["better"] else "the defaults are as good"
        gains = ", ".join(
            f"{key.partition('.')[2]} {value:.0f}"
            if value >= 10.0
            else f"{key.partition('.')[2]} {value:.2g}"
            for key, value in found["gains"].items()
        )
        lines.append(f"| `{law}` | {default:.2g} % | {best:.2g} %, {words} | {follows} | {gains} |")
    return "\n".join(lines)


def pandas_table() -> str:
    """Return the percentiles of the thousand pandas, with their intervals."""
    found = json.loads((ROOT / "benchmarks" / "thousand_pandas.json").read_text())["percentiles"]
    shown = {
        "error_share": ("error, of the path's radius", 100.0, "%"),
        "max_error_last": ("largest error of the last tenth", 1e3, "mm"),
        "torque_use": ("largest torque, of its limit", 100.0, "%"),
    }
    lines = ["| | 5 % | 50 % | 95 % |", "|---|---|---|---|"]
    for name, (words, scale, unit) in shown.items():
        cells = [
            f"{scale * each['value']:.3g} {unit} ({scale * each['low']:.3g} to "
            f"{scale * each['high']:.3g})"
            for each in found[name]
        ]
        lines.append(f"| {words} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def engine_table() -> str:
    """Return rates of sweeps, by engine."""
    lines = ["| | processor time of a case | efficiency |", "|---|---|---|"]
    for row in benchmark("sweep_engines"):
        if row["name"] != "short cases":
            rate = f"{row['processor_s']:.2f} s" if "processor_s" in row else "-"
            share = f"{row['efficiency']:.2f}" if "efficiency" in row else "-"
            lines.append(f"| {row['name']} | {rate} | {share} |")
    return "\n".join(lines)


def benchmark(name: str) -> list[dict[str, Any]]:
    """Return the rows of a benchmark's file."""
    rows: list[dict[str, Any]] = json.loads((ROOT / "benchmarks" / f"{name}.json").read_text())[
        "rows"
    ]
    return rows


(shares,) = benchmark("sample_shares")
(short,) = (row for row in benchmark("sweep_engines") if row["name"] == "short cases")

myst_substitutions = {
    "pandas": pandas_table(),
    "pandas_verdict": json.loads((ROOT / "benchmarks" / "thousand_pandas.json").read_text())[
        "verdict"
    ],
    "engines": engine_table(),
    "ms_per_case": f"{short['ms_per_case']:.2g} ms",
    "parent_ms": f"{short['parent_ms_per_case']:.2g} ms",
    "memory_tenth": f"{short['memory_MB'][0]:.0f} MB",
    "memory_all": f"{short['memory_MB'][-1]:.0f} MB",
    "memory_joined": f"{short['memory_joined_MB']:.0f} MB",
    "shares": (
        f"{shares['sample_us']:.0f} µs, of which {shares['pinocchio_us']:.0f} µs are in "
        f"{shares['calls_of_pinocchio']:.0f} calls of Pinocchio, {shares['kernels_us']:.0f} µs in "
        f"{shares['calls_of_kernels']:.0f} compiled kernels, and {shares['python_us']:.0f} µs in "
        "Python and numpy around them"
    ),
    "largest_gain": f"{shares['largest_gain']:.1f}",
    "tuned": tuned_table(),
    "laws": law_figures(),
    "modifications": modification_table(),
    "sensors": sensor_table(),
}
