"""The code of the README runs, on its robot and on others."""

import re
from pathlib import Path

import pytest

from pinadapt.description.catalogue import example_path
from tests.support.paths import ROOT

pytestmark = pytest.mark.slow

(LINES,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.S)


def executed(lines):
    """Return the names that the lines define."""
    scope = {}
    exec(lines, scope)
    return scope


def test_the_code_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    scope = executed(LINES.replace("4 * circle.period", "0.5 * circle.period"))
    rollout = scope["rollout"]
    assert rollout.diverged is None
    assert rollout.summary()["max_error_last"] < 1e-4
    assert "error, last 10 %" in capsys.readouterr().out
    assert (tmp_path / "out" / "error.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("path", "task"),
    [
        (example_path("double_pendulum_simple"), "yz"),
        (ROOT / "tests" / "data" / "arm4.urdf", "xyz"),
    ],
    ids=lambda value: value.stem if isinstance(value, Path) else None,
)
def test_only_the_path_differs_for_another_robot(path, task, tmp_path, monkeypatch):
    """Four periods at 1 kHz are shortened to what the error takes, half of one at 500 Hz."""
    monkeypatch.chdir(tmp_path)
    lines, count = re.subn(r'pa\.load\(".*?"\)', f"pa.load({str(path)!r})", LINES)
    assert count == 1 and lines.count("panda") == 0
    lines, count = re.subn(r"4 \* circle\.period", "0.5 * circle.period", lines)
    assert count == 1
    lines, count = re.subn(r"sensors=sensors\)", "sensors=sensors, dt=2e-3)", lines)
    assert count == 1
    lines = lines.replace('rollout.plot("out")', "")  # the README's own robot is drawn
    scope = executed(lines)
    rollout, circle = scope["rollout"], scope["circle"]
    assert scope["robot"].task.name == task
    assert rollout.diverged is None
    assert rollout.summary()["max_error_last"] < 0.003 * circle.radius
