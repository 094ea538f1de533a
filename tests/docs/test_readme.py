"""The code of the README runs, on its robot and on others."""

import re

import pytest

from tests.support.paths import ROOT

pytestmark = pytest.mark.slow

LINES, STANDING, LOAD = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.S)


def executed(lines):
    """Return the names that the lines define."""
    scope = {}
    exec(lines, scope)
    return scope


def test_the_code_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    scope = executed(LINES.replace("4 * circle.period", "0.2 * circle.period"))
    rollout = scope["rollout"]
    assert rollout.diverged is None
    assert rollout.summary()["max_error_last"] < 1e-4
    assert "error, last 10 %" in capsys.readouterr().out
    assert (tmp_path / "out" / "error.png").stat().st_size > 10_000


def test_a_robot_stands_and_crawls(capsys):
    """The second block follows the first one's imports, shortened to the trunk's first way."""
    lines = "import pinadapt as pa\n" + STANDING.replace("duration=3.0", "duration=0.5")
    scope = executed(lines)
    assert scope["true"].mass == pytest.approx(scope["robot"].mass + 6.0)
    assert "follows" in capsys.readouterr().out


def test_only_the_load(capsys):
    """The third block follows the first one's imports and robot; nothing has moved yet."""
    executed("\n".join([*LINES.splitlines()[:4], LOAD]))
    assert "load" in capsys.readouterr().out
