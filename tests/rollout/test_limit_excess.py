"""By how much the joints of a rollout exceed the limits of their description."""

import numpy as np
import pinocchio as pin

import pinadapt as pa
from pinadapt.rollout.limit_excess import LimitExcess

JOINTS = ("hinge", "slide", "wheel")


def arm():
    """Return a revolute, a prismatic and a continuous joint with limits."""
    model = pin.Model()
    parent = 0
    kinds = (pin.JointModelRY(), pin.JointModelPX(), pin.JointModelRUBZ())
    for name, joint in zip(JOINTS, kinds, strict=True):
        parent = model.addJoint(parent, joint, pin.SE3.Identity(), name)
    model.lowerPositionLimit = np.array([-0.5, 0.0, -1.01, -1.01])
    model.upperPositionLimit = np.array([1.0, 0.3, 1.01, 1.01])
    model.velocityLimit = np.array([2.0, 0.5, 3.0])
    model.effortLimit = np.array([10.0, 20.0, 30.0])
    return pa.Robot("arm", model, "universe", None, pin.neutral(model), pa.Friction().of(model))


MOTION = {
    "q": [[0.9, -0.1, 50.0], [1.25, 0.2, -70.0], [-0.6, 0.31, 0.0]],
    "v": [[-2.5, 0.4, 2.0], [2.25, -0.75, 2.9], [0.0, 0.5, 3.0]],
    "tau": [[9.0, 19.0, -31.0], [10.0, -20.0, 29.0], [-9.9, 4.0, 30.5]],
}


def test_the_largest_excess_of_each_joint_is_exact():
    found = LimitExcess.of(arm(), *(np.array(part) for part in MOTION.values()))
    position, velocity, effort = found.excess.T
    assert np.allclose(position, [0.25, 0.1, 0.0], rtol=1e-12)  # a wheel has no end
    assert np.allclose(velocity, [0.5, 0.25, 0.0], rtol=1e-12)
    assert np.allclose(effort, [0.0, 0.0, 1.0], rtol=1e-12)  # at the limit is within it
    assert str(found).startswith("beyond limits: hinge position by 14.32 deg, hinge velocity by ")
    assert str(found).endswith("and 2 more") and found.summary()["wheel"]["velocity"] == 0.0
