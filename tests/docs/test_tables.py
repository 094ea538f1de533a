"""The tables of the pages are those that their sweeps measured."""

import pytest

from benchmarks import sensitivity, tables
from pinadapt.sweep import CaseTable, Plan

SWEPT = sorted(path.stem for path in tables.HERE.glob("*.csv"))


@pytest.mark.parametrize(
    "page", tables.pages(), ids=lambda path: str(path.relative_to(tables.ROOT))
)
def test_a_page_has_the_measured_tables(page):
    assert tables.written(page.read_text()) == page.read_text(), "run python -m benchmarks.tables"


@pytest.mark.parametrize("name", SWEPT)
def test_a_table_has_the_cases_of_its_sweep_file(name):
    plan = Plan.read(tables.HERE / f"{name}.toml")
    rows = list(CaseTable.load(tables.HERE / f"{name}.csv").rows())
    assert len(rows) == len(plan.cases)
    for case, row in zip(plan.cases, rows, strict=True):
        assert (row["case"], row["seed"]) == (case.number, case.seed)
        assert {key: "" if row[key] is None else row[key] for key in case.values} == case.values
        assert row["reason"] if row["status"] != "done" else row["reason"] is None


def test_the_numbers_whose_sensitivity_is_measured_are_those_of_the_law():
    assert all(getattr(*place) > 0.0 for place in sensitivity.NUMBERS.values())
