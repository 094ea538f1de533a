"""A torso with two arms of four joints each, a robot without a file, and its circles."""

import numpy as np
import pinocchio as pin

import pinadapt as pa

ENDS = ["left_hand", "right_hand"]


def torso_with_two_arms() -> pin.Model:
    """Return a model: a joint about z carries two arms, with joints about z, y, y and z."""
    model = pin.Model()
    turns = [pin.JointModelRZ(), *[pin.JointModelRY()] * 2, pin.JointModelRZ()]
    limits = [np.array([x]) for x in (80.0, 4.0, -2.8, 2.8)]
    torso = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "torso", *limits)
    model.addJointFrame(torso)
    model.appendBodyToJoint(torso, pin.Inertia.FromBox(6.0, 0.3, 0.4, 0.3), pin.SE3.Identity())
    for side, name in ((1.0, "left"), (-1.0, "right")):
        parent = torso
        place = np.array([0.05, 0.2 * side, 0.2])
        for number, turn in enumerate(turns):
            joint = model.addJoint(
                parent, turn, pin.SE3(np.eye(3), place), f"{name}_{number}", *limits
            )
            frame = model.addJointFrame(joint)
            middle = pin.SE3(np.eye(3), np.array([0.12, 0.02 * side, 0.01]))
            body = pin.Inertia.FromBox(2.0 - 0.4 * number, 0.25, 0.06, 0.07)
            model.appendBodyToJoint(joint, body, middle)
            parent = joint
            place = np.array([0.25, 0.0, 0.03])
        tip = pin.SE3(pin.rpy.rpyToMatrix(0.2, 0.3 * side, 0.1), np.array([0.15, 0.0, 0.0]))
        for end, at in ((f"{name}_hand", tip), (f"{name}_wrist", pin.SE3.Identity())):
            model.addFrame(pin.Frame(end, parent, frame, at, pin.FrameType.OP_FRAME))
    model.name = "two_arms"
    return model


def two_arms(**options) -> pa.Robot:
    """Return it with both hands as task frames."""
    bent = [0.1, 0.3, 0.5, 0.9, 0.2, -0.4, 0.6, 0.8, -0.3]
    return pa.load(torso_with_two_arms(), **{"frames": ENDS, "q0": bent, **options})


def with_tools_and_loads(robot: pa.Robot) -> pa.Robot:
    """Return a robot with another tool and another load at each of its frames."""
    ball = [0.002, 0.0, 0.002, 0.0, 0.0, 0.002]
    loads = {
        robot.frames[0]: pa.Payload(0.8, [0.02, 0.0, 0.05], ball),
        robot.frames[1]: pa.Payload(0.4, [0.0, 0.02, 0.03], ball),
    }
    tools = {robot.frames[0]: [0.03, -0.02, 0.05], robot.frames[1]: [0.02, 0.03, -0.04]}
    return robot.changed(payload=loads, tool_translation=tools)


def circles(robot: pa.Robot, radius: float = 0.04, period: float = 2.0):
    """Return a circle of each hand that starts where it is at home, at speed, in other planes."""
    own = [pa.trajectories.Circle(np.zeros(3), radius, period, plane) for plane in ("yz", "xz")]
    if robot.task.size > robot.task.positions:
        swing = pa.trajectories.Swing((0.0, 1.0, 0.0), 0.1, period)
        own = [pa.trajectories.PoseTrajectory(circle, swing) for circle in own]
    return pa.trajectories.Stacked(own).starting_at(robot.position(robot.q0)).as_given()
