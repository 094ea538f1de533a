"""The benchmark on third-party robots: its names, its refusals and what it counts."""

from benchmarks import third_party_robots


def row(robot, status="done", error=None, **more):
    found = {"robot": robot, "run": "camera", "status": status, "error": error, "radius": 0.1}
    return {**found, **more}


def test_diverged_and_refused_robots_are_counted_each_by_itself():
    rows = [
        row("p/a.urdf", error=1e-5),
        row("p/b.urdf", error=3e-5),
        row("p/c.urdf", "diverged", reason="at 2 s: the torque is not finite"),
        row("p/d.urdf", "refused", reason="no mass"),
        row("p/e.urdf", "refused", reason="no joints"),
    ]
    assert third_party_robots.counts(rows).splitlines()[2] == (
        "| camera | 5 | 2 | 1 | 2 | 0.02 % | 0.03 % (`b.urdf`) |"
    )
    lines = third_party_robots.report(rows).splitlines()
    assert lines[2] == "| `p/a.urdf` | 0.01 mm, 0.01 % |"
    assert lines[4:6] == ["| `p/c.urdf` | diverged |", "| `p/d.urdf` | refused |"]
