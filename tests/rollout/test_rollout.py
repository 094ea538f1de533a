"""A rollout: its arrays, the quantities computed on demand, and its files."""

import json
from dataclasses import replace

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.rollout.recording import Evaluation, Shortfall, Slowdown
from pinadapt.rollout.summary import COMPUTED, RECORDED
from tests.support.loops import with_tool_and_load

pytestmark = pytest.mark.slow


# --- quantities computed on demand ---


def circling(robot, path=None, duration=0.05, **options):
    """Return a short run of a robot that adapts a tool and a load, its controller and its path."""
    true = with_tool_and_load(robot)
    circle = pa.trajectories.Circle(np.zeros(3), 0.05, 2.0, "yz")
    path = circle if path is None else path(circle)
    path = path.starting_at(true.position(true.q0)).as_given()
    controller = pa.make_controller(robot, **options)
    return pa.simulate(true, controller, path, duration=duration), controller, path


def test_a_record_is_without_memory_and_filters_and_has_the_same_v():
    """The last state is whole: the loop can go on from it, and from no other."""
    made = {"adaptation": "natural-memory", "modifications": "sigma"}
    robot = pa.load("ur5")
    rollout, controller, path = circling(robot, duration=0.1, **made)
    true = rollout.evaluation.true
    kept = rollout.evaluation.samples
    plant = pa.plants.PinocchioPlant(with_tool_and_load(robot))
    whole = list(pa.run(plant, controller, path, duration=0.1))
    sizes = [sample.state.flat().size for sample in kept]
    assert sizes[-1] == whole[-1].state.flat().size > 10 * max(sizes[:-1])
    V = [Evaluation(controller, true, each).storage(each) for each in (whole, kept)]
    assert np.array_equal(*V) and np.isfinite(V[0]).all()
    last = kept[-1]
    before = kept[-2]
    torque, _ = controller.step(last.state, last.measurement, last.desired, 1e-3)
    assert np.array_equal(torque, last.torque)
    with pytest.raises(pa.InputError, match="filters are those of other dynamics"):
        controller.step(before.state, before.measurement, before.desired, 1e-3)


def pose_run():
    """Return a short run of a pose task."""
    return circling(
        pa.load("panda", task="pose"), pa.trajectories.PoseTrajectory, adaptation="natural"
    )[0]


def joint_run():
    """Return a short run of a joint task with a continuous joint that exceeds a limit."""
    robot = pa.load("kinova", task="joint")
    motion = pa.trajectories.Sinusoid(robot.home_angles, 0.3, 0.3).starting_at(robot.home_angles)
    changed = pa.Events(changes={0.02: robot.changed(inertial_scale=1.2)})
    motion = motion.as_given()
    return pa.simulate(
        robot,
        pa.make_controller(robot, adaptation="natural"),
        motion,
        duration=0.05,
        events=changed,
    )


@pytest.mark.parametrize("make", [pose_run, joint_run])
def test_a_saved_rollout_is_loaded_with_its_numbers_and_plots(make, tmp_path, unpainted):
    rollout = make()
    slowed = (Slowdown(0.01, 0.02, "error", 0.5),)
    short = (Shortfall(0.03, 0.04, "contact of foot", 12.0),)
    rollout = replace(rollout, unadapted=0.01)
    vars(rollout).update(path_time=0.5 * rollout.t, slowed=slowed, infeasible=short)
    rollout.save(tmp_path)
    loaded = pa.Rollout.load(tmp_path)
    for name in RECORDED + COMPUTED:
        assert np.array_equal(getattr(loaded, name), getattr(rollout, name)), name
    assert loaded.summary() == json.loads(json.dumps(rollout.summary()))
    assert str(pa.Rollout.load(tmp_path / "rollout.npz")) == str(rollout)
    with pytest.raises(pa.InputError, match=r"nowhere/rollout\.npz: no such file"):
        pa.Rollout.load(tmp_path / "nowhere")
    assert str(loaded) == str(rollout) and loaded.task == rollout.task
    assert len(loaded.plot(tmp_path / "plots")) == 3
    with pytest.raises(pa.InputError, match="no robots"):
        loaded.learned()
