"""A robot that is written as URDF and read again is the same; nothing else in the text changes."""

import xml.etree.ElementTree as ElementTree

import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa
from tests.support.chains import catalogue_robot, random_state
from tests.support.descriptions import arm4

pytestmark = pytest.mark.slow

ROBOTS = ["panda", "scara", "kinova"]
LOAD = pa.Payload(0.8, (0.02, -0.01, 0.05), (0.004, 0.0, 0.005, 0.0, 0.0, 0.002))


def numbers(root):
    """Return element path -> attributes, for what is neither a mesh nor an extension."""
    found = {}

    def collect(element, path):
        for part in element:
            if part.tag not in ("mesh", "mujoco", "texture") and isinstance(part.tag, str):
                i = list(element.iter(part.tag)).index(part)
                here = (*path, f"{part.tag}:{part.get('name', i)}")
                found[here] = dict(part.attrib)
                collect(part, here)

    collect(ElementTree.fromstring(ElementTree.tostring(root)), ())
    return found


def reloaded(robot, folder, frame=None):
    """Write a robot into a folder and load it from there, at the same locked joints."""
    robot.save(folder / "out.urdf")
    return pa.load(
        folder / "out.urdf",
        frame=frame or robot.frame,
        task=robot.task.name,
        joint_effects=robot.friction.present,
    )


def same_torques(robot, other, tolerance):
    """Check torques and positions of two robots with the same joints at random states."""
    assert other.joint_names == robot.joint_names
    for seed in range(5):
        q, v, a = random_state(robot, np.random.default_rng(seed))
        tau, expected = (
            pin.rnea(r.model, r.model.createData(), q, v, a) + r.friction.torque(v)
            for r in (other, robot)
        )
        assert np.abs(tau - expected).max() <= tolerance * max(1.0, np.abs(expected).max())
        assert np.allclose(other.position(q), robot.position(q), rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("name", ROBOTS)
def test_a_changed_robot_is_the_same_when_read_again(name, tmp_path):
    robot = catalogue_robot(name)
    changed = robot.changed(
        payload=LOAD,
        tool_translation=(0.03, -0.02, 0.12),
        link_translation={robot.joint_names[2]: (0.0, 0.01, 0.02)},
        viscous=0.3,
        coulomb=0.2,
        armature=0.05,
    )
    # panda's fingers are locked closed in a file, and at 0.1 mm of that in the catalogue
    same_torques(changed, reloaded(changed, tmp_path), 1e-4 if name == "panda" else 1e-12)


@pytest.mark.parametrize("name", ROBOTS)
def test_only_changes_are_written(name):
    robot = catalogue_robot(name)
    before = numbers(ElementTree.fromstring(robot.origin.urdf.text))
    assert numbers(ElementTree.fromstring(robot.urdf())) == before
    after = numbers(ElementTree.fromstring(robot.changed(payload=LOAD).urdf()))
    touched = {path[:2] for path in after if after[path] != before.get(path)}
    (link,) = {path[0] for path in touched}
    assert link.startswith("link:") and {path[1].split(":")[0] for path in touched} == {"inertial"}


def test_a_body_lighter_than_its_fixed_links_is_the_same_when_read_again(tmp_path):
    robot = catalogue_robot("panda")  # hand and fingers weigh as much as its last link
    light = robot.changed(inertial_scale={"panda_joint7": 0.3})
    same_torques(light, reloaded(light, tmp_path), 1e-4)


def test_a_tree_without_a_text_of_its_own_is_the_same_when_read_again(tmp_path):
    described = catalogue_robot("solo8_fl_leg").drawn.whole  # four legs, none of them the first
    robot = pa.load(described, task="joint").changed(armature=0.02)
    robot.save(tmp_path / "out.urdf")
    again = pa.load(tmp_path / "out.urdf", task="joint", joint_effects=True)
    order = [again.joint_names.index(name) for name in robot.joint_names]
    q = np.linspace(0.1, 0.9, robot.model.nv)
    theirs = np.zeros(q.size)
    theirs[order] = q
    tau, expected = (
        pin.rnea(model, model.createData(), x, x, x)
        for model, x in ((again.model, theirs), (robot.model, q))
    )
    assert np.abs(tau[order] - expected).max() < 1e-12 * np.abs(expected).max()


def test_a_moved_tool_that_has_a_mass_leaves_it_where_it_is(tmp_path):
    inertial = '<inertial><mass value="0.4"/><inertia ixx="1e-3" ixy="0" ixz="0" iyy="1e-3" '
    heavy = f'<link name="tip">{inertial}iyz="0" izz="1e-3"/></inertial></link>'
    robot = pa.load(arm4(tmp_path, ('<link name="tip"/>', heavy)), frame="tip")
    moved = robot.changed(tool_translation=(0.0, 0.02, 0.1))
    same_torques(moved, reloaded(moved, tmp_path, "tip_learned"), 1e-12)
    assert "with the frame tip_learned. -->" in moved.urdf()
