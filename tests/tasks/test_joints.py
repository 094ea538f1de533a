"""Joints are shown in degrees, slides in millimetres."""

import pinocchio as pin

from pinadapt.tasks import JointTask


def test_slides_are_shown_in_millimetres():
    model = pin.Model()
    for name, joint in (("turns", pin.JointModelRZ()), ("slides", pin.JointModelPX())):
        model.addJoint(model.njoints - 1, joint, pin.SE3.Identity(), name)
    groups = JointTask.of_joints(model).groups
    assert [(group.shown.unit, *group.rows) for group in groups] == [("mm", 1), ("deg", 0)]
