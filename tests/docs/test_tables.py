"""The tables of the pages are those that their sweeps measured."""

import pytest

from benchmarks import tables
from pinadapt.exceptions import InputError
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


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A folder with the sweep of a function in place of the benchmarks."""
    monkeypatch.setattr(tables, "HERE", tmp_path)
    monkeypatch.setattr("benchmarks.timing.HERE", tmp_path)
    monkeypatch.setattr(tables, "RUNNING", tmp_path / "running")
    (tmp_path / "marks").mkdir()
    return tmp_path


def sweep_file(place, values, function="slow"):
    (place / "t.toml").write_text(
        f'function = "tests.support.swept:{function}"\npath = "."\ncsv = true\n[vary]\n'
        f'a = {values}\nplace = ["{place / "marks"}"]\n'
    )


def test_only_what_is_missing_or_asked_for_is_measured(place):
    def runs():
        return {path.name: len(path.read_text()) for path in (place / "marks").iterdir()}

    sweep_file(place, [1, 2])
    tables.measure("t", None, 0)
    sweep_file(place, [3, 2, 1])
    tables.measure("t", None, 0)
    found = CaseTable.load(place / "t.csv")
    assert runs() == {"1": 1, "2": 1, "3": 1} and found["result"].tolist() == [3.0, 2.0, 1.0]
    assert "seconds" not in found.columns and not (place / "running" / "t").exists()
    tables.measure("t", ["a=2"], 0)
    assert runs() == {"1": 1, "2": 2, "3": 1}
    tables.measure("t", [], 0)
    assert runs() == {"1": 2, "2": 3, "3": 2} and CaseTable.load(place / "t.csv").same_as(found)
    with pytest.raises(InputError, match="Did you mean 'place'"):
        tables.measure("t", ["plac=2"], 0)
    with pytest.raises(InputError, match=r"there is no s\.toml"):
        tables.measure("s", None, 0)
