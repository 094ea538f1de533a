"""A wrist described far lighter than the load that it gets, as of many industrial arms."""

import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa

pytestmark = pytest.mark.slow

MASSES = (6.0, 5.0, 4.0, 2.0, 0.35, 0.08)  # [kg] a flange of 80 g, and 0.9 kg to carry
LENGTHS = (0.18, 0.6, 0.12, 0.6, 0.02, 0.02)  # [m]
CAMERA = pa.Camera(30.0, 0.06)  # [1/s], [s]
JOINTS = {"x": pin.JointModelRX, "y": pin.JointModelRY, "z": pin.JointModelRZ}


def light_wrist():
    model = pin.Model()
    parent = 0
    at = np.array([0.0, 0.0, 0.4])
    model.name = "light wrist"
    for k, (axis, mass, length) in enumerate(zip("zyyxyx", MASSES, LENGTHS, strict=True)):
        parent = model.addJoint(
            parent,
            JOINTS[axis](),
            pin.SE3(np.eye(3), at),
            f"joint{k + 1}",
            *(np.array([limit]) for limit in (200.0, 5.0, -2.8, 2.8)),
        )
        at = np.array([0.0, 0.0, length] if k == 1 else [length, 0.0, 0.0])
        inertia = mass * (0.2 * length + 0.02) ** 2 * np.eye(3)
        model.appendBodyToJoint(parent, pin.Inertia(mass, 0.4 * at, inertia), pin.SE3.Identity())
    flange = pin.SE3(np.eye(3), np.array([0.11, 0.0, 0.0]))
    model.addFrame(pin.Frame("flange", parent, 0, flange, pin.FrameType.BODY))
    return pa.load(model, frame="flange")


def test_a_spinning_wrist_does_not_swing_the_estimate_of_the_tool():
    """The tool is learned no faster than the arm can follow, whatever the camera, by a short lag.

    From rest, as motions begin: at speed the wrist may be lost even if the tool is known.
    """
    robot = light_wrist()
    tool = 0.05 * robot.reach * np.array([0.0, -1.0, 0.0])
    true = robot.changed(
        tool_translation=tool, payload=pa.Payload(mass=0.05 * robot.mass, com=tool)
    )
    model = robot.changed(inertial_scale=0.7)
    controller = pa.make_controller(model, dt=1e-3, lag=0.002)
    circle = pa.reachable_circle(robot).starting_at(true.position(true.q0))
    rollout = pa.simulate(
        true,
        controller,
        circle,
        duration=2.0,
        record_every=5,
        sensors=pa.Sensors(camera=CAMERA),
    )
    assert rollout.diverged is None
    assert rollout.distance[-100:].max() <= 0.05 * circle.radius
