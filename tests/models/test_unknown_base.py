"""Unknown position of the base in the camera's frame, adapted together with the tool."""

import numpy as np
import pytest

import pinadapt as pa
from tests.support.chains import catalogue_robot

pytestmark = pytest.mark.slow

MOVED = np.array([0.4, -0.3, 0.2])


def moved(name):
    """Return a robot with a displaced base, a tool and a load, and a circle for it."""
    robot = catalogue_robot(name)
    true = robot.changed(
        tool_translation=[0.03, -0.02, 0.08],
        payload=pa.Payload(mass=1.0, com=[0.0, 0.0, 0.05]),
        link_translation={robot.joint_names[0]: MOVED},
    )
    circle = pa.trajectories.Circle(np.zeros(3), 0.1, 4.0, "xy").starting_at(true.position(true.q0))
    return robot, true, circle


@pytest.mark.parametrize("name", ["panda", "scara", "kinova"])
def test_unknown_base_affects_positions_and_not_velocities(name):
    (robot, true, _), rng = moved(name), np.random.default_rng(0)
    m, kinematics = robot.task.positions, pa.models.FrameKinematics(robot, ["base", "tool"])
    q = true.at(true.home_angles + 0.3 * rng.standard_normal(robot.model.nv)).q0
    error = kinematics.value(true) - kinematics.initial
    kinematics.update(kinematics.initial, q, rng.standard_normal(robot.model.nv))
    assert kinematics.names[:3] == ("base_x", "base_y", "base_z")
    assert not kinematics.Y_k[:, :3].any()
    assert error[:3] == pytest.approx(MOVED)
    X_k = kinematics.X_k
    assert X_k[:, :3] == pytest.approx(np.eye(3)[:m])
    assert X_k @ error == pytest.approx(true.position(q) - robot.position(q), abs=1e-12)


@pytest.mark.parametrize(("name", "camera"), [("panda", pa.Camera(30.0, 0.06))])
def test_base_and_tool_are_adapted_together(name, camera):
    """Their errors compensate while the tool hardly rotates; the path is followed nevertheless."""
    robot, true, circle = moved(name)
    controller = pa.make_controller(
        robot,
        unknown=pa.Unknown(tool=True, base=True),
        adaptation="natural",
        sensors=pa.Sensors(camera=camera),
        dt=4e-3,
    )
    rollout = pa.simulate(
        true, controller, circle, duration=6.0, record_every=5, sensors=pa.Sensors(camera=camera)
    )
    assert rollout.diverged is None
    last = rollout.distance[-40:].max()
    assert last < (6e-3 if camera else 3e-3) and last < 0.6 * rollout.distance[:40].max()
    seen = rollout.a_k[-1] - rollout.a_k_true
    assert np.linalg.norm(seen) < 0.6 * np.linalg.norm(rollout.a_k[0] - rollout.a_k_true)
