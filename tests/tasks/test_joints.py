"""Joints are shown in degrees, slides alone in millimetres."""

import pinocchio as pin

from pinadapt.tasks import JointTask


def test_slides_alone_are_shown_in_millimetres():
    model = pin.Model()
    for shown, joint in (("mm", pin.JointModelPX()), ("deg", pin.JointModelRZ())):
        model.addJoint(model.njoints - 1, joint, pin.SE3.Identity(), shown)
        assert JointTask.of_joints(model).groups[0].shown.unit == shown
