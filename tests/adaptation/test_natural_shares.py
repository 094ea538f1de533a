"""Natural adaptation with relative rates of bodies, and their default."""

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.adaptation.adaptation import Drive, Estimate
from pinadapt.zoo.experiment import zoo_case
from tests.support.chains import catalogue_robot

SHARES = [1.0, 7.0, 0.3]


def bodies():
    """Return the cone of three bodies of the Panda, their parameters, and other physical ones."""
    robot = catalogue_robot("panda")
    truth = robot.changed(inertial_scale=1.4, payload=pa.Payload(1.0, [0.05, 0.02, 0.1]))
    cone = pa.adaptation.BodyInequality(robot.joint_names[-3:])
    a, a_true = (
        np.concatenate([body.toDynamicParameters() for body in each.model.inertias.tolist()[-3:]])
        for each in (robot, truth)
    )
    return cone, a, a_true


def test_each_body_adapts_with_its_own_gain():
    cone, a, _ = bodies()
    g = np.random.default_rng(0).standard_normal(30)
    together = pa.adaptation.Natural(0.3, cone, shares=SHARES)
    drive = Drive(g[None], None, gradient=g)
    start = Estimate(a)
    for body, share in enumerate(SHARES):
        mine = slice(10 * body, 10 * body + 10)
        alone = pa.adaptation.Natural(0.3 * share, cone)
        assert np.allclose(
            together.rate(start, drive).value[mine], alone.rate(start, drive).value[mine]
        )
        moved, own = (each.step(start, drive, 1e-4).value for each in (together, alone))
        assert np.allclose(moved[mine], own[mine], rtol=1e-12, atol=1e-15)
        assert np.allclose(together.gain(start)[mine], alone.gain(start)[mine])
    assert np.allclose(together.gain_times(start, np.eye(30)), together.gain(start))


def test_the_last_body_is_adapted_as_if_it_carried_a_load_or_were_thick():
    """A tenth of the robot's mass, but for TIAGo's wrist, 2.4 mm thick in its description."""
    found = []
    for name in ("tiago_arm", "panda", "ur5"):
        robot = zoo_case(name).estimated
        unknown = pa.Unknown(friction=False, armature=False)
        shares = pa.make_controller(robot, unknown=unknown).adaptation_d.inner.shares
        loaded = 1.0 + 0.1 * robot.mass / robot.model.inertias[robot.model.njoints - 1].mass
        thick = (1e-2 * robot.reach / 2.359e-3) ** 2 if name == "tiago_arm" else 1.0
        assert (shares[:-1] == 1.0).all()
        assert shares[-1] == pytest.approx(max(loaded, thick), rel=1e-3)
        found.append(shares[-1] / loaded)
    assert found[0] > 5.0 and found[1:] == pytest.approx([1.0, 1.0])
