"""A base that moves freely, as six joints without motors in front of the tree."""

from __future__ import annotations

import pinocchio as pin

from .chain import restore_names, with_unique_names

BASE_JOINTS = ("base_x", "base_y", "base_z", "base_yaw", "base_pitch", "base_roll")
_KINDS = (
    *(pin.JointModelPX, pin.JointModelPY, pin.JointModelPZ),
    *(pin.JointModelRZ, pin.JointModelRY, pin.JointModelRX),
)


def with_base_joints(tree: pin.Model) -> pin.Model:
    """Return a tree whose root is moved by six joints: three slides, then yaw, pitch and roll.

    All laws, regressors and proofs hold as for a chain, since these are coordinates as any other:
    q is (x, y, z, yaw, pitch, roll, joints), in world axes. They are singular at a pitch of 90
    degrees, where no robot stands.
    """
    base = pin.Model()
    joint = 0
    for name, kind in zip(BASE_JOINTS, _KINDS, strict=True):
        joint = base.addJoint(joint, kind(), pin.SE3.Identity(), name)
        base.addJointFrame(joint)
    tree = with_unique_names(tree)
    model = pin.appendModel(base, tree, base.nframes - 1, pin.SE3.Identity())
    restore_names(model)
    model.name = tree.name
    model.gravity.linear = tree.gravity.linear
    return model
