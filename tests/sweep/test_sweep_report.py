"""Statistics of a sweep against independent computations, and figures of any table."""

import numpy as np
import pytest

from pinadapt.sweep import CaseTable, Plan
from pinadapt.sweep.sweep_report import SweepReport, percentile, rate


def test_the_rate_has_wilsons_interval():
    found = rate(np.arange(50) < 47)
    assert str(found).startswith("47 of 50 (94 %; 95% interval 83.8 % to 97.9 %)")
    assert rate(np.ones(20, bool)).low < 0.9


def test_the_interval_of_a_percentile_has_the_stated_coverage():
    rng = np.random.default_rng(0)
    hits = 0
    p = 0.95
    for _ in range(400):
        found = percentile(rng.exponential(size=100), p)
        hits += found.low <= -np.log(1.0 - p) <= found.high
        assert found.low <= found.value <= found.high
    assert 0.93 <= hits / 400 <= 1.0


def test_lost_cases_count_as_worst():
    values = np.array([*np.arange(95.0), *[np.inf] * 5])
    assert percentile(values, 0.5).value == 49.0
    assert percentile(values, 0.95).value == 94.0 and percentile(values, 0.95).high == np.inf
    assert percentile(values, 0.99).value == np.inf
    assert np.isnan(percentile(np.arange(10.0), 0.05).low)  # too few cases for a bound
    assert str(percentile(np.arange(10.0), 0.05)) == "0 (? to 2)"


def report(count=200, lost=True, **options):
    """Return a report of results that follow from a, fall with b, and do not depend on c."""
    vary = {"a": "uniform(1, 2)", "b": "uniform(1, 2)", "c": "normal(0, 1)", "w": ["x", "y"]}
    plan = Plan.of(
        {"function": dict, "vary": vary, "samples": count // 2, "method": "lhs", "success": "ok"}
    )
    rows = []
    for case in plan.cases:
        v = case.values
        gone = lost and v["a"] > 1.9
        value = v["a"] ** 3 - 0.4 * v["b"] + (5.0 if v["w"] == "y" else 0.0)
        row = {"case": case.number, "seed": case.seed, **v}
        row |= (
            {"status": "diverged", "reason": "at 1 s"} if gone else {"status": "done", "reason": ""}
        )
        rows.append(row | ({"value": None, "ok": None} if gone else {"value": value, "ok": True}))
    return SweepReport(CaseTable(rows), plan, **options)


@pytest.mark.parametrize("lost", [True, False])
def test_the_page_has_all_figures_and_marks_lost_cases(lost, request):
    if not lost:  # painted once
        request.getfixturevalue("unpainted")
    found = report(60, lost, folder="out")
    page = found.page()
    alone = (found.lost or found.worst)[0]
    assert f"pinadapt sweep out --case {alone}<" in page
    assert page.count("data:image/png;base64,") == 2 and "http" not in page.split("</style>")[1]
    assert ("<h2>Lost cases" in page) == lost
    ax = found.map("a", "b").axes[0]
    assert len(ax.collections[1].get_offsets()) == int(found.table.lost.sum())
