"""A mobile base does not count as reach; a load that the motors cannot hold causes a warning."""

import pytest

import pinadapt as pa
from pinadapt.description.chain import effort_limits
from pinadapt.robot.motors import overloaded

LINK = """<link name="{name}"><inertial><origin xyz="{half} 0 0"/><mass value="{mass}"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
JOINT = """<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
<origin xyz="{at}"/><axis xyz="{axis}"/><limit effort="{effort}" velocity="2" {range}/></joint>"""


def mobile_arm(folder, effort=100.0, limits=""):
    """Write an arm of two metres on a cart of 100 kg, which rolls along x, and return its path."""
    turns = 'lower="-2.5" upper="2.5"'
    parts = [
        '<robot name="mobile"><link name="floor"/>',
        LINK.format(name="cart", half=0, mass=100),
        LINK.format(name="upper", half=0.5, mass=5),
        LINK.format(name="lower", half=0.5, mass=3),
        '<link name="tip"/>',
    ]
    for name, kind, parent, child, at, axis, most, span in (
        ("roll", "prismatic", "floor", "cart", "0 0 0.5", "1 0 0", effort, limits),
        ("shoulder", "revolute", "cart", "upper", "0 0 0.5", "0 1 0", 400, turns),
        ("elbow", "revolute", "upper", "lower", "1 0 0", "0 1 0", 200, turns),
    ):
        parts.append(
            JOINT.format(
                name=name,
                kind=kind,
                parent=parent,
                child=child,
                at=at,
                axis=axis,
                effort=most,
                range=span,
            )
        )
    parts.append(
        '<joint name="end" type="fixed"><parent link="lower"/><child link="tip"/>'
        '<origin xyz="1 0 0"/></joint></robot>'
    )
    path = folder / "mobile.urdf"
    path.write_text("\n".join(parts))
    return path


def test_a_load_that_the_motors_cannot_hold_causes_a_warning_before_the_run(tmp_path):
    robot = pa.load(mobile_arm(tmp_path), task="xz", q0=[0.0, -0.3, 0.6])
    heavy = robot.changed(payload=pa.Payload(mass=40.0))
    assert overloaded(robot, effort_limits(robot.model)) is None
    told = overloaded(heavy, effort_limits(heavy.model))
    assert "shoulder (" in told and "elbow (" in told and "roll" not in told and "N m" in told
    controller, path = pa.make_controller(robot), pa.trajectories.Hold(heavy.position(heavy.q0))
    with pytest.warns(UserWarning, match="cannot hold the true robot at its home pose: shoulder"):
        rollout = pa.simulate(heavy, controller, path, duration=0.5)
    assert "motors were at their limit" in rollout.verdict
