"""The verdict on a run: one line in the table, the summary and comparisons."""

import json
from dataclasses import replace

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.cli.command_line import main
from pinadapt.cli.compare import comparison_table
from pinadapt.description.catalogue import robots_folder
from pinadapt.rollout.limit_excess import LimitExcess
from pinadapt.rollout.summary import FOLLOWS, LOST, ROUGHLY
from pinadapt.zoo.experiment import ACCURATE, BETTER
from tests.support.loops import run

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("blank_pictures")]

PLANAR = str(robots_folder() / "planar_2r" / "wang_xie_2009.toml")


@pytest.fixture(scope="module")
def rollout():
    """Return a run on a circle of 50 mm; its errors are replaced."""
    return run("planar_2r", duration=0.1)


def with_error(rollout, first, last, **changes):
    """Return the rollout of 10 s with errors [m] that fall from one to the other."""
    n = len(rollout.t)
    x = rollout.x_d.copy()
    x[:, 0] += np.linspace(first, last, n)
    x[-n // 10 :, 0] = rollout.x_d[-n // 10 :, 0] + last
    return replace(rollout, x=x, t=np.linspace(0.0, 10.0, n), **changes)


@pytest.mark.parametrize(
    ("last", "grade", "words"),
    [
        (0.00005, FOLLOWS, "up to 0.05 mm, 0.1 % of the path's 50 mm; joint limits"),
        (0.00099, FOLLOWS, "up to 0.99 mm, 2 % of"),
        (0.00101, ROUGHLY, "up to 1.01 mm, 2 % of"),
        (0.0099, ROUGHLY, "up to 9.9 mm, 20 % of"),
        (0.0435, LOST, "up to 43.5 mm, 87 % of"),
        (6.0, LOST, "up to 6000 mm, 12000 % of"),
    ],
)
def test_the_grade_depends_on_the_error_relative_to_the_path(rollout, last, grade, words):
    judged = with_error(rollout, last, last)
    assert judged.grade == grade and judged.verdict.startswith(f"{grade}: ")
    assert words in judged.verdict and "\n" not in judged.verdict
    assert judged.error_share == pytest.approx(last / 0.05)
    summary = judged.summary()
    assert (summary["verdict"], summary["error_share"]) == (judged.verdict, judged.error_share)
    assert str(judged).endswith(f"\n\n{judged.verdict}")
    row = comparison_table([judged]).splitlines()[-1]
    assert row.endswith(grade) and " ok" not in row and f"{100 * last / 0.05:.2f}" in row
    assert ("try" in judged.verdict) == (grade != FOLLOWS)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"adaptation": "none"}, 'try controller.adaptation = "natural"'),
        ({"law": "resolved-acceleration"}, "try another controller.law"),
        ({"saturated": np.ones(100, bool)}, "motors were at their limit 100% of the time"),
        ({}, "try controller.gamma_d three times as large"),
        ({"first": 0.2}, "try a longer simulation.duration"),
        ({"diverged": 0.1, "reason": "the torque is lost."}, "s: the torque is lost; error"),
        ({"diverged": 0.1, "reason": "the torque is lost."}, "; try a fifth of"),
        (
            {"diverged": 0.1, "reason": "lost.", "saturated": np.arange(100) < 96},
            "the motors were at their limit 96% of the time: try a longer",
        ),
        (
            {"diverged": 0.1, "reason": "lost.", "saturated": np.arange(100) < 30},
            "the motors were at their limit 30% of the time; try a fifth of",
        ),
    ],
)
def test_the_verdict_of_a_bad_run_says_what_to_try(rollout, changes, words):
    first = changes.pop("first", 0.04)
    assert words in with_error(rollout, first, 0.04, **changes).verdict


def test_the_verdict_compares_with_the_error_without_adaptation(rollout):
    verdict = with_error(rollout, 0.0001, 0.0001, unadapted=0.004).verdict
    assert "40 times less than the 4 mm without adaptation" in verdict
    verdict = with_error(rollout, 0.003, 0.003, unadapted=0.004).verdict
    assert "75% of the 4 mm without adaptation" in verdict
    assert "not adapted [mm]" not in comparison_table([rollout])
    known = with_error(rollout, 0.001, 0.001, unadapted=0.004)
    assert "not adapted [mm]" in comparison_table([known, rollout])


@pytest.mark.parametrize("kept", [1, 2, 3])
def test_few_samples_have_a_verdict(rollout, kept):
    names = ("t", "q", "v", "tau", "x", "x_d", "a_k", "a_d", "saturated")
    few = {name: getattr(with_error(rollout, 0.04, 0.04), name)[-kept:] for name in names}
    judged = replace(rollout, **few, evaluation=None)
    judged.__dict__.update(limits=rollout.limits, damping=np.zeros(kept))
    assert judged.grade == LOST and "try " in judged.verdict


def test_the_verdict_names_exceeded_limits(rollout):
    limits = LimitExcess(
        ("a", "b"),
        (False, True),
        True,
        replace_excess([0.1, 0.0], [0.0, 0.02], [3.0, 4.0]),
        None,
    )
    judged = with_error(rollout, 0.0001, 0.0001)
    judged.__dict__["limits"] = limits
    assert (
        "beyond limits: a position by 5.73 deg, a effort by 3 N m, b velocity by 20 mm/s and 1"
        in (judged.verdict)
    )


def replace_excess(*rows):
    """Return the largest excess of position, velocity and effort."""
    from pinadapt.rollout.limit_excess import Excess

    return Excess(*(np.array(row) for row in rows))


@pytest.mark.parametrize(
    ("motion", "extent"),
    [
        (pa.trajectories.Circle(np.zeros(2), 0.1, 2.0), 0.1),
        (pa.trajectories.Lissajous(np.zeros(2), [0.3, 0.4], [1, 2], 2.0), 0.5),
        (pa.trajectories.Sinusoid(np.zeros(2), [0.3, 0.4], 2.0), 0.5),
        (pa.trajectories.Waypoints([[0.0, 0.0], [0.6, 0.8]], 1.0), 0.5),
        (pa.trajectories.Hold(np.zeros(2)), 0.0),
        (pa.trajectories.PoseTrajectory(pa.trajectories.Circle(np.zeros(3), 0.1, 2.0)), 0.1),
    ],
    ids=lambda value: type(value).__name__,
)
def test_motions_state_their_extent(motion, extent):
    assert motion.extent == pytest.approx(extent)
    assert motion.shifted(
        np.ones(6 if extent == 0.1 else 2)[: motion.at(0.0).xd_d.size]
    ).extent == (pytest.approx(extent))


def test_a_motion_of_the_users_has_the_extent_of_its_samples(rollout):
    own = with_error(rollout, 0.001, 0.001, path_extent=None)
    assert own.extent == pytest.approx(0.5 * np.linalg.norm(np.ptp(own.x_d, axis=0)))
    point = with_error(rollout, 0.0005, 0.0005, path_extent=0.0)
    assert point.error_share is None and point.grade == FOLLOWS
    assert with_error(rollout, 0.02, 0.02, path_extent=0.0).grade == LOST


def test_the_grade_of_a_pose_depends_on_its_angle_too():
    robot = pa.load("ur5", task="pose")
    path = pa.trajectories.PoseTrajectory(
        pa.trajectories.Circle(np.zeros(3), 0.05, 2.0)
    ).starting_at(robot.position(robot.q0))
    turned = pa.simulate(
        robot, pa.make_controller(robot, adaptation="natural"), path, duration=0.02, progress=False
    )
    assert turned.grade == FOLLOWS and " deg" in turned.verdict
    lost = replace(turned, x_d=np.hstack([turned.x[:, :3], np.tile([0, 0, 0, 1.0], (20, 1))]))
    assert lost.grade == LOST and lost.error_share == 0.0


def test_the_command_run_prints_the_verdict_last(tmp_path, capsys):
    arguments = ["run", PLANAR, "--no-html", "--out", str(tmp_path), "--unadapted"]
    assert main([*arguments, "--set", "simulation.duration=0.4"]) == 0
    last = capsys.readouterr().out.splitlines()[-1]
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert last == summary["verdict"] and "without adaptation" in last
    assert summary["error_share"] == pytest.approx(summary["max_error_last"] / 0.3)


def test_compare_also_runs_each_adaptive_law_without_adaptation(tmp_path, capsys):
    laws = "resolved-acceleration,adaptive-jacobian"
    arguments = ["compare", PLANAR, "--laws", laws, "--unadapted", "--out", str(tmp_path)]
    assert main([*arguments, "--set", "simulation.duration=0.05"]) == 0
    verdicts = [row["verdict"] for row in json.loads((tmp_path / "compare.json").read_text())]
    assert ["without adaptation" in verdict for verdict in verdicts] == [False, True]
    assert "not adapted [mm]" in capsys.readouterr().out


def test_the_zoo_takes_its_thresholds_from_the_verdict():
    from pinadapt.rollout import summary

    assert (ACCURATE, BETTER) == (summary.ACCURATE, summary.BETTER)


@pytest.mark.parametrize("mode", ["sampled", "continuous"])
@pytest.mark.parametrize("part", [0, 1, 2])
def test_a_motion_that_turns_nan_ends_the_run_with_its_rollout(mode, part):
    class Broken(pa.trajectories.Circle):
        def at(self, t):
            desired = super().at(t)
            spoiled = [value * np.nan if i == part else value for i, value in enumerate(desired)]
            return pa.Desired(*spoiled) if t > self.radius else desired

    robot = pa.load("planar_2r")
    path = Broken(np.zeros(2), 0.02, 2.0).starting_at(robot.position(robot.q0))
    rollout = pa.simulate(
        robot,
        pa.make_controller(robot, adaptation="natural"),
        path.as_given(),
        duration=0.05,
        engine=pa.Engine(continuous=mode == "continuous"),
    )
    assert rollout.diverged == pytest.approx(0.02, abs=1.1e-3) and 20 <= len(rollout.t) <= 21
    assert rollout.reason.startswith("desired") and "gamma" not in rollout.verdict
    assert "\n" not in rollout.verdict and np.isfinite(rollout.tau).all()
    path.radius = -1.0
    with pytest.raises(pa.InputError, match="desired"):
        pa.simulate(
            robot,
            pa.make_controller(robot, adaptation="natural"),
            path.as_given(),
            duration=0.05,
            engine=pa.Engine(continuous=mode == "continuous"),
        )


@pytest.mark.parametrize("progress", [None, True, False, list])
def test_progress_is_shown_on_terminals_and_on_request(progress, capsys):
    robot = pa.load("planar_2r")
    path = pa.trajectories.Circle(np.zeros(2), 0.02, 2.0).starting_at(robot.position(robot.q0))
    pa.simulate(
        robot,
        pa.make_controller(robot, adaptation="natural"),
        path,
        duration=0.01,
        progress=progress,
    )
    assert ("planar_2r" in capsys.readouterr().err) == (progress is True)


def test_init_prints_the_pre_run_check(tmp_path, capsys, monkeypatch):
    assert main(["init", "planar_2r", "--out", str(tmp_path / "a.toml")]) == 0
    assert "Pre-run check passed: 'separation' is stable at 1 ms." in capsys.readouterr().out
    monkeypatch.setattr("pinadapt.simulation.prepare.preflight", lambda *_: ["dt is too long."])
    assert main(["init", "planar_2r", "--out", str(tmp_path / "b.toml")]) == 0
    out, err = capsys.readouterr()
    assert err == "pinadapt: warning: dt is too long.\n" and "check before" not in out
