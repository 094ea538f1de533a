"""The verdict on a run: one line in the table, the summary and comparisons."""

from dataclasses import replace

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.rollout.recording import FOLLOWS, LOST, ROUGHLY
from pinadapt.scenario.comparison import comparison_table
from tests.support.loops import run

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("blank_pictures")]


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


def test_a_path_as_long_as_rounding_is_a_point(rollout):
    x_d = rollout.x_d[0] + 1e-15 * rollout.x_d
    judged = replace(rollout, x=x_d, x_d=x_d, path_extent=None)
    assert judged.extent == 0.0 and judged.grade == FOLLOWS


@pytest.mark.parametrize(
    ("share", "grade"),
    [(0.0198, FOLLOWS), (0.0202, ROUGHLY), (0.198, ROUGHLY), (0.202, LOST), (120.0, LOST)],
)
def test_the_grade_depends_on_the_error_relative_to_the_path(rollout, share, grade):
    """To the piece of the circle that ran."""
    last = 0.5 * share * np.linalg.norm(np.ptp(rollout.x_d, axis=0))
    judged = with_error(rollout, last, last)
    assert judged.grade == grade and judged.verdict.startswith(f"{grade}: ")
    assert judged.error_share == pytest.approx(share)
    summary = judged.summary()
    assert (summary["verdict"], summary["error_share"]) == (judged.verdict, judged.error_share)
    assert str(judged).endswith(f"\n\n{judged.verdict}")
    row = comparison_table([judged]).splitlines()[-1]
    assert row.endswith(grade) and f"{100 * share:.2f}" in row


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


@pytest.mark.parametrize(("mode", "part"), [("sampled", 0), ("sampled", 2), ("continuous", 1)])
def test_a_motion_that_turns_nan_ends_the_run_with_its_rollout(mode, part):
    class Broken(pa.trajectories.Circle):
        def at(self, t):
            desired = super().at(t)
            spoiled = [value * np.nan if i == part else value for i, value in enumerate(desired)]
            return pa.Desired(*spoiled) if t > self.radius else desired

    robot = pa.load("planar_2r")
    path = Broken(np.zeros(2), 0.02, 2.0).starting_at(robot.position(robot.q0))
    controller = pa.make_controller(robot, adaptation="natural")
    options = {"duration": 0.05, "engine": pa.Engine(continuous=mode == "continuous")}
    rollout = pa.simulate(robot, controller, path.as_given(), **options)
    assert rollout.diverged == pytest.approx(0.02, abs=1.1e-3) and 20 <= len(rollout.t) <= 21
    assert rollout.reason.startswith("desired") and np.isfinite(rollout.tau).all()
