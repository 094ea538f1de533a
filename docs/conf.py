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
    """Return the figures of `make laws.table` for each law, as text."""
    return {
        row["law"]: {
            "error": error_text(row["error"], row["unit"]),
            "camera": error_text(row["error_camera"], row["unit"]),
            "cost": f"{row['step_ratio']:.0f}",
        }
        for row in swept("laws")
    }


def error_text(error: float | None, unit: str) -> str:
    """Return an error in mm or degrees, without line breaks."""
    if error is None:
        return "lost"
    return (
        f"{1e3 * error:.2g}\N{NO-BREAK SPACE}mm" if unit == "m" else f"{math.degrees(error):.2g}°"
    )


def swept(name: str) -> list[dict[str, Any]]:
    """Return the rows of the table of a sweep."""
    return list(CaseTable.load(ROOT / "benchmarks" / f"{name}.csv").rows())


def benchmark(name: str) -> list[dict[str, Any]]:
    """Return the rows of a benchmark's file."""
    rows: list[dict[str, Any]] = json.loads((ROOT / "benchmarks" / f"{name}.json").read_text())[
        "rows"
    ]
    return rows


(shares,) = benchmark("sample_shares")
*_, memory = benchmark("control_step")
samples = {row["name"]: row for row in benchmark("simulated_sample")}
alone = samples["panda with friction"]
taught = next(row for row in swept("learned") if row["table"] == "motions")
(hidden,) = (
    row
    for row in swept("scenarios")
    if row["run"] == "hidden, law (11)" and row["engine"] == "mujoco"
)
later_runs = {row["adaptation"]: row for row in swept("scenarios") if row["table"] == "later"}
(cost,) = (row for row in swept("governor") if row["event"] == "cost")
(short,) = (row for row in benchmark("sweep_engines") if row["name"] == "short cases")

myst_substitutions = {
    "pandas_verdict": json.loads((ROOT / "benchmarks" / "thousand_pandas.json").read_text())[
        "verdict"
    ],
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
    "learned_before": f"{taught['before']:.2f} N m",
    "hidden_law": error_text(hidden["last"], "m"),
    **{
        f"{name}_{when}": error_text(later_runs[adaptation][key], "m")
        for name, adaptation in (
            ("squares", "least-squares"),
            ("composite", "natural-composite"),
        )
        for when, key in (("soon", "half[15]"), ("late", "last"))
    },
    "governor_us": f"{cost['governor_us']:.0f} µs",
    "memory_median": f"{memory['median_ratio']:.1f}",
    "memory_mean": f"{memory['mean_ratio']:.1f}",
    "memory_period": f"{1.0 / memory['solving_share']:.0f}",
    "memory_solving": f"{1e-3 * (memory['solving_us'] - memory['step_us']):.2f}",
    "memory_calls": f"{samples['panda with the memory']['sample_ratio']:.0f}",
    "sample_calls": f"{alone['sample_ratio']:.0f}",
    "faster": f"{1e3 / (alone['sample_ratio'] * alone['aba_us']):.0f}",
    "laws": law_figures(),
}
