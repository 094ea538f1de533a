"""What was learned, as a robot, a URDF and numbers to start from."""

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.cli.command_line import main
from pinadapt.models.bodies import unphysical_bodies
from pinadapt.models.excited import around
from tests.support.chains import catalogue_robot

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("blank_pictures")]

ROBOTS = ["ur5", "scara", "kinova"]


@cache
def run(name, duration=1.0, **options):
    """Return a controller and its short run on a robot that differs from its model, once."""
    described = catalogue_robot(name)
    true = described.changed(
        payload=pa.Payload(0.5, (0.0, 0.0, 0.03), (1e-3, 0.0, 1e-3, 0.0, 0.0, 1e-3)),
        tool_translation=(0.01, 0.02, 0.03),
        viscous=0.2,
    )
    options = {"adaptation": "natural", "dt": 4e-3, **options}
    controller = pa.make_controller(described.changed(inertial_scale=0.8), **options)
    path = pa.reachable_circle(true)
    return controller, pa.simulate(true, controller, path, duration=duration)


@pytest.mark.parametrize("name", ROBOTS)
def test_the_learned_robot_has_the_estimates_for_its_parameters(name):
    controller, rollout = run(name)
    learned = rollout.learned(all_estimates=True)
    state = rollout.evaluated().samples[-1].state
    assert not np.allclose(state.a_d, controller.dynamics.initial)
    assert np.allclose(controller.kinematics.value(learned), state.a_k, atol=1e-12)
    assert np.allclose(controller.dynamics.value(learned), state.a_d, rtol=1e-9, atol=1e-12)
    assert learned.drawn is not None


def test_parameters_that_are_not_adapted_keep_their_initial_values():
    controller, rollout = run(
        "ur5", unknown=pa.Unknown(bodies="payload", friction=False, armature=False)
    )
    believed = controller.kinematics.robot
    learned = rollout.learned()
    same = [
        a.isApprox(b) for a, b in zip(believed.model.inertias, learned.model.inertias, strict=True)
    ]
    assert same == [True] * 6 + [False]
    assert all(
        a.isApprox(b)
        for a, b in zip(believed.model.jointPlacements, learned.model.jointPlacements, strict=True)
    )
    assert not learned.friction.present and not learned.model.armature.any()


def test_unphysical_bodies_are_refused():
    controller = pa.make_controller(catalogue_robot("ur5"), adaptation="gradient")
    state = controller.init(pa.plants.PinocchioPlant(catalogue_robot("ur5")).measure())
    a_d = state.a_d.copy()
    a_d[20] = -1.0  # the mass of the third body
    with pytest.raises(pa.ParameterError, match="elbow_joint"):
        controller.learned(state._replace(dynamic=state.dynamic.with_value(a_d)))


# --- what the motion does not excite ---


def predicted(rollout, a_d):
    """Return the error of the torques of a run's motion at parameters (p), each joint alike."""
    return rollout.motion_torques.sums.relative_error(a_d)


@pytest.mark.parametrize(
    ("name", "adaptation"),
    [("panda", "natural"), ("ur5", "natural-memory"), ("scara", "gradient"), ("ur5", "gradient")],
)
def test_unexcited_parameters_and_their_torques_stay_unchanged(name, adaptation):
    controller, rollout = run(name, 1.2 if adaptation == "gradient" else 1.0, adaptation=adaptation)
    state = rollout.evaluated().last_state
    dynamics = controller.dynamics
    kept = rollout.parameters().start(controller)["a_d"]
    before, after = (predicted(rollout, a) for a in (state.a_d, kept))
    assert abs(after - before) < min(0.1 * before, 1e-3) + 1e-9
    assert not unphysical_bodies(kept[: dynamics.inertial.size], rollout.joint_names)
    physical = around(dynamics, state.a_0)
    assert physical.divergence(kept) <= physical.divergence(state.a_d) + 1e-6
    excited = rollout.motion_torques.excited
    open_ones = excited.root @ excited._vectors[:, excited.effects < 1e-7]
    T, h = physical.local(kept)
    slopes = np.linalg.solve(T.T, h) @ open_ones  # of the distance, along what the torques leave
    assert open_ones.shape[1] > 3
    assert np.abs(slopes).max() < 1e-3 * np.linalg.norm(np.linalg.solve(T.T, h) @ excited.root)


# --- numbers to start from ---


@pytest.mark.parametrize("name", ROBOTS)
def test_a_file_keeps_every_number_with_name_and_unit(name, tmp_path):
    controller, rollout = run(name)
    learned = rollout.parameters()
    learned.save(tmp_path / "learned.json")
    assert pa.LearnedParameters.load(tmp_path / "learned.json") == learned
    start = learned.start(controller)
    state = rollout.evaluated().samples[-1].state
    assert (start["a_k"] == state.a_k).all() and learned.remark
    with pytest.warns(UserWarning, match="what a 'twin' has learned"):
        replace(learned, robot="twin").start(controller)
    start = rollout.parameters(all_estimates=True).start(controller)
    assert (start["a_d"] == state.a_d).all()
    slide = "slide_joint.viscous"
    assert learned.units.get(slide, "N s/m") == "N s/m" and "" not in learned.units.values()
    text = (tmp_path / "learned.json").read_text()
    first = next(iter(learned.dynamic))
    (tmp_path / "number.json").write_text(text.replace(f'"{first}": ', '"5": ', 1))
    with pytest.raises(pa.ParameterError, match="1 unknown to it"):
        pa.LearnedParameters.load(tmp_path / "number.json").start(controller)
    for wrong in ({"robot": 3}, {"units": 3}, {"dynamic": [1.0]}, {"shape": {"a": 3}}):
        (tmp_path / "wrong.json").write_text(json.dumps({**json.loads(text), **wrong}))
        with pytest.raises(pa.ParameterError, match=r"wrong\.json: is no file"):
            pa.LearnedParameters.load(tmp_path / "wrong.json")


# --- on the command line ---


def test_a_run_saves_its_estimates_and_another_starts_from_them(tmp_path):
    scenario = tmp_path / "one.toml"
    scenario.write_text(
        '[robot]\nsource = "scara"\n[truth]\npayload = {mass = 0.5}\n'
        '[trajectory]\nkind = "circle"\nradius = 0.05\nperiod = 2.0\n'
        "[simulation]\nduration = 0.2\n"
    )
    assert main(["run", str(scenario), "--out", str(tmp_path / "one"), "--no-html"]) == 0
    assert "Written by pinadapt" in (tmp_path / "one" / "learned.urdf").read_text()
    again = pa.load(tmp_path / "one" / "learned.urdf", frame="tool", task="xyz")
    assert again.joint_names == catalogue_robot("scara").joint_names
    (tmp_path / "two.toml").write_text(
        scenario.read_text() + '[model]\nlearned = "one/learned.json"\n'
    )
    assert (
        main(["run", str(tmp_path / "two.toml"), "--out", str(tmp_path / "two"), "--no-html"]) == 0
    )
    written = json.loads((tmp_path / "one" / "learned.json").read_text())
    assert "Not excited by the motion" in written["remark"]
    first = np.load(tmp_path / "two" / "rollout.npz")["a_d"][0]
    assert first.tolist() == list(written["dynamic"].values())
    wrong = [*("run", str(tmp_path / "two.toml")), "--set", "unknown.bodies='payload'"]
    assert main([*wrong, "--out", str(tmp_path / "three")]) == 2
