"""A rollout: its arrays, the quantities computed on demand, and its files."""

import json
import pickle
from dataclasses import fields, replace

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.models.right_inverse import RightInverse
from pinadapt.plots.figures import draw_errors
from pinadapt.rollout.recording import Evaluation, Slowdown
from pinadapt.rollout.summary import COMPUTED, RECORDED, WATCHED
from tests.support.chains import catalogue_robot as load
from tests.support.loops import ARRAYS, run, with_tool_and_load

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("name", ["planar_2r", "scara", "panda"])
def test_rollouts_have_one_row_a_sample(name):
    robot, rollout = (
        load(name),
        run(name, duration=0.05, control={"unknown": pa.Unknown(friction=False, armature=False)}),
    )
    rows = {
        "q": robot.model.nq,
        "v": robot.model.nv,
        "tau": robot.model.nv,
        "x": robot.task.size,
        "a_d": 10 * robot.model.nv,
    }
    assert np.allclose(rollout.t, 1e-3 * np.arange(50), atol=1e-12)
    assert {key: getattr(rollout, key).shape for key in rows} == {
        key: (50, width) for key, width in rows.items()
    }
    assert np.array_equal(rollout.q[0], robot.q0) and not rollout.v[0].any()
    assert np.allclose(rollout.x, [robot.position(q) for q in rollout.q], atol=1e-12)
    assert np.array_equal(rollout.error, rollout.x - rollout.x_d)
    assert rollout.diverged is None and "DIVERGED" not in str(rollout)


def test_continuous_mode_also_records_the_end():
    assert np.allclose(
        run(duration=0.05, engine=pa.Engine(continuous=True)).t, 1e-3 * np.arange(51), atol=1e-12
    )


def test_a_truth_outside_the_model_is_none(tmp_path):
    rollout = run(
        "ur5",
        truth={"inertial_scale": 1.1},
        control={"unknown": pa.Unknown(bodies="payload")},
        duration=0.01,
    )
    assert rollout.a_d_true is None and rollout.lyapunov is None and rollout.a_k_true is not None
    rollout.save(tmp_path)
    assert {"a_d_true", "lyapunov"}.isdisjoint(np.load(tmp_path / "rollout.npz").files)


def test_save_and_plot_write_files(tmp_path, blank_pictures):
    rollout = run(duration=0.02)
    rollout.save(tmp_path / "new" / "folder")
    paths = rollout.plot(tmp_path / "new" / "folder")
    assert [path.name for path in paths] == ["error.png", "parameters.png", "torque.png"]
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in paths)
    saved = np.load(tmp_path / "new" / "folder" / "rollout.npz")
    assert all(np.array_equal(saved[name], getattr(rollout, name)) for name in ARRAYS)
    assert (
        json.loads((tmp_path / "new" / "folder" / "summary.json").read_text()) == rollout.summary()
    )


def test_plots_of_a_run_without_unknowns_are_drawn(tmp_path, unpainted):
    assert (
        len(
            run(control={"unknown": pa.Unknown(tool=False, bodies="none")}, duration=0.01).plot(
                tmp_path
            )
        )
        == 3
    )


def test_a_law_that_adapts_from_torques_alone_names_its_adaptation():
    robot = load("planar_2r", task="joint")
    controller = pa.make_controller(robot, law="middleton-goodwin", adaptation="natural")
    assert "natural-composite" in str(controller)
    rollout = pa.simulate(
        robot, controller, pa.trajectories.Hold(robot.home_angles), duration=0.002
    )
    assert rollout.summary()["adaptation"] == "natural-composite"
    assert "natural-composite: 0 kinematic" in str(rollout)


def test_the_summary_names_the_adaptation_that_ran():
    for adaptation in ("natural", "gradient", "none"):
        assert (
            run(control={"adaptation": adaptation}, duration=0.002).summary()["adaptation"]
            == adaptation
        )


# --- quantities computed on demand ---


def tracked(task=None, singular=0.0):
    """Return a short rollout that adapts a tool and a load, damped below s_0; its controller."""
    described = pa.load("panda", task=task)
    true = with_tool_and_load(described)
    controller = pa.make_controller(described, adaptation="natural")
    controller.limits = replace(controller.limits, singular=singular)
    path = pa.trajectories.Circle(np.zeros(3), 0.05, 2.0, "yz")
    path = (pa.trajectories.PoseTrajectory(path) if task == "pose" else path).starting_at(
        true.position(true.q0)
    )
    return pa.simulate(true, controller, path.as_given(), duration=0.05), controller


@pytest.mark.parametrize("modifications", [None, "sigma"])
def test_a_record_is_without_memory_and_filters_and_has_the_same_v(modifications):
    """The last state is whole: the loop can go on from it, and from no other."""
    described = pa.load("ur5")
    true = with_tool_and_load(described)
    controller = pa.make_controller(
        described, adaptation="natural-memory", modifications=modifications
    )
    path = pa.trajectories.Circle(np.zeros(3), 0.05, 2.0, "yz")
    path = path.starting_at(true.position(true.q0)).as_given()
    rollout = pa.simulate(true, controller, path, duration=0.1)
    plant = pa.plants.PinocchioPlant(true)
    whole = list(pa.run(plant, controller, path, duration=0.1))
    kept = rollout.evaluation.samples
    sizes = [sample.state.flat().size for sample in kept]
    assert sizes[-1] == whole[-1].state.flat().size > 10 * max(sizes[:-1])
    V = [Evaluation(controller, rollout.evaluation.true, each).lyapunov for each in (whole, kept)]
    assert np.array_equal(*V) and np.isfinite(V[0]).all()
    last, before = kept[-1], kept[-2]
    torque, _ = controller.step(last.state, last.measurement, last.desired, 1e-3)
    assert np.array_equal(torque, last.torque)
    with pytest.raises(pa.InputError, match="filters are those of other dynamics"):
        controller.step(before.state, before.measurement, before.desired, 1e-3)


def test_nothing_is_evaluated_before_it_is_read():
    rollout, _ = tracked()
    record = {"controller", "true", "samples"}
    assert rollout.distance.max() > 0.0 and vars(rollout.evaluation).keys() == record
    assert rollout.min_eig_M_hat.min() > 0.0
    assert vars(rollout.evaluation).keys() == record | {"smallest_eigenvalues"}


@pytest.mark.parametrize("task", ["xyz", "pose"])
def test_eigenvalues_and_singular_values_are_those_of_the_estimates(task):
    rollout, controller = tracked(task, singular=1.0)
    assert rollout.damping.max() > 0.0
    for k, sample in enumerate(rollout.evaluation.samples):
        controller.kinematics.update(rollout.a_k[k], rollout.q[k], rollout.v[k])
        controller.dynamics.load(rollout.a_d[k])
        inverse = RightInverse(controller.kinematics.J, controller.limits.singular)
        M = controller.dynamics.mass_matrix(sample.truth.q)
        sigma = np.linalg.svd(inverse.J, compute_uv=False)[-1]
        assert np.isclose(rollout.min_eig_M_hat[k], np.linalg.eigvalsh(M)[0])
        assert np.isclose(rollout.min_singular_J_hat[k], sigma)
        assert np.isclose(rollout.damping[k], inverse.damping, rtol=1e-6, atol=1e-12)
        share = inverse.damping / (sigma**2 + inverse.damping)
        assert np.isclose(rollout.damping_share[k], share, rtol=1e-6, atol=1e-12)


def test_first_and_last_v_are_those_of_the_whole_run():
    rollout, _ = tracked()
    assert np.array_equal(rollout.lyapunov_ends, rollout.lyapunov[[0, -1]])
    assert f"{rollout.lyapunov[-1]:.4g}" in str(rollout)
    evaluation = rollout.evaluated()
    first = evaluation.samples[0]
    wild = first.measurement._replace(v=np.full(first.measurement.v.size, 1e3))
    V = evaluation.storage([first, first._replace(measurement=wild)])  # the second was bridged
    assert V[0] == rollout.lyapunov[0] and np.isnan(V[1])


def test_a_pickled_rollout_has_the_same_numbers_and_no_controller():
    rollout, _ = tracked()
    copy = pickle.loads(pickle.dumps(pickle.loads(pickle.dumps(rollout))))
    assert copy.evaluation is None and rollout.evaluation is not None
    for name in RECORDED + COMPUTED + WATCHED:
        assert np.array_equal(getattr(copy, name), getattr(rollout, name)), name
    assert copy.summary() == rollout.summary() and str(copy) == str(rollout)


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


@pytest.mark.parametrize("make", [lambda: tracked("pose")[0], joint_run, run], ids=range(3))
def test_a_saved_rollout_is_loaded_with_its_numbers_and_plots(make, tmp_path, unpainted):
    rollout = make()
    slowed = (Slowdown(0.01, 0.02, "error", 0.5),)
    rollout = replace(rollout, unadapted=0.01, path_time=0.5 * rollout.t, slowed=slowed)
    rollout.save(tmp_path)
    loaded = pa.Rollout.load(tmp_path)
    for name in RECORDED + COMPUTED + WATCHED:
        assert np.array_equal(getattr(loaded, name), getattr(rollout, name)), name
    assert loaded.summary() == json.loads(json.dumps(rollout.summary()))
    assert str(loaded) == str(rollout) and loaded.task == rollout.task
    assert np.array_equal(loaded.lyapunov_ends, rollout.lyapunov_ends)
    if make is not run:  # of a pose and of joints; of positions they are drawn above
        assert len(loaded.plot(tmp_path / "plots")) == 3
    with pytest.raises(pa.InputError, match="no robots"):
        loaded.learned()


def test_a_folder_without_a_run_is_not_loaded(tmp_path):
    with pytest.raises(pa.InputError, match=r"has no summary\.json"):
        pa.Rollout.load(tmp_path)
    (tmp_path / "summary.json").write_text('{"title": "of an older version"}')
    (tmp_path / "rollout.npz").write_bytes(b"nothing")
    with pytest.raises(pa.InputError, match="does not hold a run of this version"):
        pa.Rollout.load(tmp_path)


def test_joint_errors_are_in_radians_and_shown_in_degrees():
    """The rollout of a joint task, from given arrays."""
    rollout, _ = tracked()
    task = pa.tasks.JointTask.of_chain(load("panda").model)
    q_d = rollout.q + np.radians(2.0) * np.eye(7)[3]
    joints = pa.Rollout(
        **{
            **{f.name: getattr(rollout, f.name) for f in fields(rollout)},
            "task": task,
            "x": rollout.q,
            "x_d": q_d,
        }
    )
    assert np.allclose(joints.distance, np.radians(2.0)) and joints.angle is None
    assert "2.000 deg" in str(joints) and " mm" not in str(joints)
    assert joints.summary()["max_error_last"] == pytest.approx(np.radians(2.0))
    _, axes = draw_errors(joints)
    assert [ax.get_ylabel() for ax in axes][:2] == ["joints error [deg]", "|q - q_d| [deg]"]
    assert np.allclose(axes[1].lines[0].get_ydata(), 2.0)


def test_a_figure_draws_v_at_some_samples_of_the_run():
    """At most a thousand, the first and the last among them, each as in V of all samples."""
    robot = load("planar_2r")
    controller = pa.make_controller(robot, adaptation="natural", unknown="tool")
    rollout = pa.simulate(robot, controller, pa.reachable_circle(robot), duration=1.1)
    t, V = rollout.lyapunov_curve
    assert len(t) == len(V) == 1000 and t[0] == rollout.t[0] and t[-1] == rollout.t[-1]
    assert np.array_equal(V, rollout.lyapunov[np.searchsorted(rollout.t, t)])
