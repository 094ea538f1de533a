"""The code on the pages of the site runs without changes."""

import re

import pytest

import pinadapt as pa
from tests.support.paths import ROOT

pytestmark = pytest.mark.slow

DOCS = ROOT / "docs"


def blocks(page):
    """Return the Python blocks of a page."""
    return re.findall(r"```python\n(.*?)```", (DOCS / f"{page}.md").read_text(), re.S)


def test_the_quickstart_runs(tmp_path, monkeypatch, capsys, blank_pictures):
    monkeypatch.chdir(tmp_path)
    scope = {}
    for block in blocks("quickstart"):
        if "while True" not in block:  # the loop of an arm, see below
            exec(re.sub(r"duration=[45]\.0", "duration=0.9", block), scope)
    for name in ("rollout", "wave", "legs"):
        assert scope[name].summary()["max_error_last"] < 1e-3
    assert (tmp_path / "out" / "error.png").is_file()
    assert "@article" in capsys.readouterr().out


def test_the_page_without_calibration_runs():
    """Shortened, the first one at half of its rate; both begin after two seconds of excitation."""
    scope = {}
    of_tracker, of_camera = blocks("without_calibration")
    assert "dt=0.002" in of_tracker
    exec(of_tracker.replace("0.002", "0.004").replace("duration=3.0", "duration=1.0"), scope)
    assert scope["rollout"].distance.max() < 1e-4
    found = scope["rollout"].tracker().tracker
    true = scope["true"].tracker
    assert found.placement.homogeneous == pytest.approx(true.homogeneous, abs=1e-5)
    exec(of_camera.replace("duration=1.0", "duration=0.5"), scope)
    assert scope["rollout"].distance.max() < 2e-3


@pytest.mark.usefixtures("forked")
def test_the_realtime_loop_on_the_page_on_hardware_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    exec(blocks("hardware")[0], {"__name__": "__main__"})
    assert "stopped" in capsys.readouterr().out


def test_the_declaration_of_actuators_on_the_page_on_hardware_runs(capsys):
    scope = {"pa": pa, "robot": pa.load("ur5")}
    exec(blocks("hardware")[2], scope)
    assert capsys.readouterr().out == "[]\n"
    assert scope["springs"].elastic and scope["controller"].limits.actuators is scope["late"]


def test_the_page_on_whole_robots_runs(tmp_path, monkeypatch, capsys):
    several, standing, steps, linkage, grasp = blocks("whole_robots")
    monkeypatch.chdir(ROOT)
    scope = {}
    with pytest.warns(UserWarning, match="not physical"):  # TIAGo's shoulders
        shorter = several.replace("duration=2.0", "duration=1.0")
        shorter = shorter.replace("controller(robot)", "controller(robot, dt=2e-3)")
        exec(shorter.replace('"learned.urdf"', f'"{tmp_path}/learned.urdf"'), scope)
    assert scope["rollout"].distance[-50:].max() < 1e-5
    true = scope["true"]
    frames = [f"{frame}_learned" for frame in scope["robot"].frames]
    learned = pa.load(tmp_path / "learned.urdf", frames=frames)
    assert learned.position(true.q0) == pytest.approx(true.position(true.q0), abs=1e-6)
    shorter = standing.replace('"payload")', '"payload", dt=2e-3)')
    exec(shorter.replace('"learned.urdf"', f'"{tmp_path}/learned.urdf"'), scope)
    assert scope["rollout"].distance[-50:].max() < 5e-4
    learned = pa.load(tmp_path / "learned.urdf", base="free", contacts=scope["feet"])
    assert learned.model.inertias[6].mass == pytest.approx(11.0, rel=0.02)
    exec(steps.replace("duration=3.0", "duration=0.9"), scope)
    assert scope["rollout"].distance[-50:].max() < 5e-4
    exec(linkage, scope)
    assert "True False  True False" in capsys.readouterr().out
    exec(grasp, scope)
    assert scope["arms"].constraints[-1] == scope["grasp"]


def test_the_code_of_the_readme_runs(tmp_path, monkeypatch, capsys):
    """From top to bottom; nothing has moved in the third block."""
    monkeypatch.chdir(tmp_path)
    lines, stands, load = blocks("../README")
    scope = {}
    exec(lines.replace("4 * circle.period", "0.2 * circle.period"), scope)
    rollout = scope["rollout"]
    assert rollout.diverged is None
    assert rollout.summary()["max_error_last"] < 1e-4
    assert "error, last 10 %" in capsys.readouterr().out
    assert (tmp_path / "out" / "error.png").stat().st_size > 10_000
    exec(stands.replace("duration=3.0", "duration=0.2"), scope)
    assert scope["true"].mass == pytest.approx(scope["robot"].mass + 6.0)
    assert "follows" in capsys.readouterr().out
    exec(load, scope)
    assert "load" in capsys.readouterr().out
