"""The random chains of other tests: every size, every kind of joint, physical bodies."""

from collections import defaultdict

import numpy as np
import pinocchio as pin
from hypothesis import given, settings

from pinadapt.description.chain import check_joints, check_mass_matrix, is_physical, is_slide
from tests.support.chains import SIZES, chains, each_size, seeded


def kind(joint):
    return "prismatic" if is_slide(joint) else "continuous" if joint.nq == 2 else "revolute"


def first_axis(robot):
    """Return the direction (3) in which the first joint turns or slides, in world axes."""
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, robot.q0, np.eye(robot.model.nv)[0])
    motion = data.oMi[1].act(data.v[1])
    return motion.linear if is_slide(robot.model.joints[1]) else motion.angular


def test_draws_reach_both_ends_and_every_kind_of_joint_in_all_directions():
    """One joint to ten, and of single joints each kind, with axes that lie in no plane."""
    sizes, axes = set(), defaultdict(list)

    @given(chains)
    @settings(seeded, max_examples=250)
    def draw(robot):
        sizes.add(robot.model.nv)
        if robot.model.nv == 1:
            axes[kind(robot.model.joints[1])].append(first_axis(robot))

    draw()
    assert sizes == set(SIZES) == set(range(1, 11))
    assert set(axes) == {"revolute", "continuous", "prismatic"}
    for some in axes.values():
        assert np.linalg.svd(np.array(some), compute_uv=False)[-1] > 0.1


@each_size()
@given(robot=chains)
@seeded
def test_chains_are_robots_that_the_library_takes(robot):
    model = robot.model
    assert model.nv == len(robot.joint_names) == len(robot.friction.viscous) and robot.q0.shape == (
        model.nq,
    )
    check_joints(model, range(1, model.njoints))
    check_mass_matrix(model, [robot.q0])
    assert all(is_physical(body.toDynamicParameters()) for body in model.inertias[1:])
