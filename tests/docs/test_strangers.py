"""The benchmark on third-party robots: its names, its refusals and what it counts."""

import pytest

from benchmarks import strangers


def test_a_robot_of_a_package_that_is_missing_names_what_to_install(monkeypatch):
    monkeypatch.setattr("sys.path", [])
    with pytest.raises(FileNotFoundError, match=r"pip install .* pybullet==.*PYTHONPATH"):
        strangers.measure("pybullet_data/a1/a1.urdf", "perfect")
    with pytest.raises(FileNotFoundError, match="nor a package 'nobody'"):
        strangers.measure("nobody/a.urdf", "perfect")


def test_a_package_is_found_but_not_imported(tmp_path, monkeypatch):
    folder = tmp_path / "a_package_of_robots"
    folder.mkdir()
    (folder / "__init__.py").write_text("raise RuntimeError('imported')")
    (folder / "arm.urdf").write_text("<robot")
    monkeypatch.syspath_prepend(tmp_path)
    name = "a_package_of_robots/arm.urdf"
    assert strangers.located(name) == folder / "arm.urdf"
    row = strangers.measure(name, "perfect")
    assert row["status"] == "refused" and row["reason"].startswith(f"{name}: not well-formed")
    assert str(tmp_path) not in row["reason"]
    with pytest.raises(ValueError, match="'lidar' is not one of perfect, camera"):
        strangers.measure(name, "camera, lidar")


def row(robot, status="done", error=None, **more):
    sizes = {"frame": "tip", "joints": 6.0, "radius": 0.1} if status != "refused" else {}
    return {"robot": robot, "run": "camera", "status": status, "error": error, **sizes, **more}


def test_diverged_and_refused_robots_are_counted_each_by_itself():
    rows = [
        row("p/a.urdf", error=1e-5),
        row("p/b.urdf", error=3e-5),
        row("p/c.urdf", "diverged", reason="at 2 s: the torque is not finite"),
        row("p/d.urdf", "refused", reason="no mass"),
        row("p/e.urdf", "refused", reason="no joints"),
    ]
    assert strangers.counts(rows).splitlines()[2] == (
        "| camera | 5 | 2 | 1 | 2 | 0.02 % | 0.03 % (`b.urdf`) |"
    )
    lines = strangers.report(rows).splitlines()
    assert lines[2] == "| `a.urdf` | 0.01 mm, 0.01 % |  |"
    assert lines[4].endswith("| diverged | at 2 s: the torque is not finite |")
    assert lines[5] == "| `d.urdf` | refused | no mass |"
