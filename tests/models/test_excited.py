"""What a motion excites of the dynamic parameters, and the error of predicted torques."""

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.models.bodies import unphysical_bodies
from pinadapt.models.excited import TOLD_APART, TorqueSums, around, names_together, scales
from tests.support.chains import catalogue_robot


def dynamics_of(name="ur5", **options):
    """Return the dynamics of a controller."""
    return pa.make_controller(catalogue_robot(name), **options).dynamics


def sums_of(dynamics, at, true, states):
    """Return the sums over the torques that some states take."""
    joints = dynamics.regressor(*states[0]).shape[0]
    sums = TorqueSums(joints, at)
    Y = np.array([dynamics.regressor(*state) for state in states])
    dynamics.load(true)
    tau = np.array([dynamics.torque(*state) for state in states])
    sums.add(Y, Y @ (true - at), tau)
    return sums, Y, tau


def states_of(nv, moving, count=40):
    """Return random states in which only some joints move."""
    rng = np.random.default_rng(0)
    kept = np.isin(np.arange(nv), moving)
    return [tuple(rng.standard_normal((3, nv)) * kept) for _ in range(count)]


def test_errors_of_the_torques_are_those_of_the_regressor():
    dynamics, rng = dynamics_of(), np.random.default_rng(1)
    true = dynamics.initial
    at, other = (true * (1.0 + 0.2 * rng.standard_normal(true.size)) for _ in range(2))
    sums, Y, tau = sums_of(dynamics, at, true, states_of(6, range(6)))
    assert sums.size == pytest.approx(np.sqrt(np.mean(tau**2)))
    for a in (at, other):
        assert sums.error(a) == pytest.approx(np.sqrt(np.mean((Y @ (a - true)) ** 2)))
        own = np.sqrt(np.mean(tau**2, axis=0))
        each = np.maximum(own, 0.01 * own.max())
        assert sums.relative_error(a) == pytest.approx(
            np.sqrt(np.mean((Y @ (a - true) / each) ** 2))
        )
    assert sums.error(true) < 1e-6 * sums.size


def test_combinations_are_scaled_and_change_the_torques_independently():
    dynamics = dynamics_of()
    sums, *_ = sums_of(dynamics, dynamics.initial, dynamics.initial, states_of(6, range(6)))
    L = scales(dynamics, dynamics.initial)
    found = sums.excited(dynamics.names, L)
    C = found.combinations
    assert np.allclose(C @ L @ L.T @ C.T, np.eye(found.rank), atol=1e-9)
    squares = C @ L @ L.T @ found.squares @ L @ L.T @ C.T
    assert np.allclose(squares, np.diag(found.effects[: found.rank] ** 2), atol=1e-9)
    assert found.effects[found.rank - 1] > TOLD_APART >= found.effects[found.rank]
    d = np.random.default_rng(2).standard_normal(dynamics.size) * np.abs(dynamics.initial)
    assert np.sum((found.rows @ d) ** 2) == pytest.approx(d @ found.squares @ d)


@pytest.mark.parametrize("moving", [[0], [0, 1, 2], range(6)])
def test_unexcited_parameters_are_named(moving):
    """Random poses of the moving joints; a joint at rest shows neither friction nor rotor."""
    dynamics, moving = dynamics_of(), list(moving)
    true, joints = dynamics.initial, catalogue_robot("ur5").joint_names
    found = sums_of(dynamics, true, true, states_of(6, moving))[0].excited(
        dynamics.names, scales(dynamics, true)
    )
    still = {name for name, no in zip(found.names, found.still, strict=True) if no}
    for index, joint in enumerate(joints):
        assert (f"{joint}.coulomb" in still) == (index not in moving)
    assert "shoulder_pan_joint.m" in still
    if moving == [0]:
        assert "coulomb of shoulder_lift_joint, elbow_joint" in names_together(
            sorted(still, key=found.names.index)
        )
    else:
        assert "elbow_joint.m" not in still


def test_words_gather_whole_bodies_and_kinds():
    dynamics = dynamics_of()
    found = sums_of(dynamics, dynamics.initial, dynamics.initial, states_of(6, [0]))[0].excited(
        dynamics.names, scales(dynamics, dynamics.initial)
    )
    nothing = type(found)(found.names, 0.0 * found.squares, found.root)
    joints = ", ".join(catalogue_robot("ur5").joint_names)
    kinds = ("bodies", "armature", "viscous", "coulomb")
    assert nothing.still.all() and names_together(nothing.names) == "; ".join(
        f"{kind} of {joints}" for kind in kinds
    )
    assert nothing.rank == 0 and nothing.distance(dynamics.initial, 2.0 * dynamics.initial) == 0.0


def test_the_scale_of_a_body_is_thirty_per_cent_of_it():
    """L^-1 (s a - a) has the length |log s| / 0.3 sqrt(4) for a small change s of a body."""
    dynamics = dynamics_of(unknown=pa.Unknown(friction=False, armature=False))
    a = dynamics.initial
    z = np.linalg.solve(scales(dynamics, a), 0.003 * a)
    each = np.linalg.norm(z.reshape(6, 10), axis=1)
    assert np.allclose(each, 0.01 * 2.0, rtol=1e-6)


def test_bodies_that_are_not_physical_have_a_centre_close_by():
    dynamics = dynamics_of()
    a = dynamics.initial.copy()
    a[20], a[-1] = -1.0, -1.0
    centre = around(dynamics, a).center
    assert not unphysical_bodies(centre[:60], list("abcdef")) and centre[-1] > 0.0
    same = np.delete(np.arange(a.size), [*range(20, 30), a.size - 1])
    assert np.array_equal(centre[same], a[same])


def test_lumped_parameters_have_their_typical_values_for_scales():
    unknown = pa.Unknown(tool=False, translations=["tool", "elbow_joint"])
    dynamics = dynamics_of(unknown=unknown, adaptation="gradient")
    scale = np.diag(scales(dynamics, dynamics.initial))[: dynamics.inertial.size]
    typical = np.abs(dynamics.typical[: scale.size])
    assert np.array_equal(scale, 0.3 * np.maximum(typical, 1e-3 * np.abs(dynamics.typical).max()))


def test_without_torques_nothing_is_divided_by_them():
    dynamics = dynamics_of("planar_2r", unknown=pa.Unknown(friction=False, armature=False))
    rest = [(np.zeros(2), np.zeros(2), np.zeros(2))]
    sums, *_ = sums_of(dynamics, dynamics.initial, dynamics.initial, rest)
    found = sums.excited(dynamics.names, scales(dynamics, dynamics.initial))
    assert sums.size == 0.0 == sums.relative_error(dynamics.initial)
    assert found.rank == 0 and found.still.all()
