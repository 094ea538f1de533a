"""MuJoCo model files as a user might have them, written from a robot's numbers as text."""

import numpy as np
import pinocchio as pin

from pinadapt.description.chain import axis_of, is_slide

ROWS, COLUMNS = (0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)  # of fullinertia

HEAD = """<mujoco model="own">
  <compiler angle="radian"/>
  <option timestep="0.002" integrator="RK4" gravity="{gravity}"/>
  <worldbody>
    {scene}
    <body name="stand" {stand}>
"""
TAIL = """    </body>
  </worldbody>
  <actuator>{actuators}</actuator>
</mujoco>
"""


def text(numbers):
    return " ".join(repr(float(number)) for number in np.ravel(numbers))


def place(placement):
    x, y, z, w = pin.Quaternion(placement.rotation).coeffs()
    return f'pos="{text(placement.translation)}" quat="{text([w, x, y, z])}"'


def own_file(robot, path, *, stand=None, rename=str, inside="", scene="", turned=()):
    """Write a robot's chain into a file, on a stand, with more on the last body and in the scene.

    ``rename`` gives the file's name of a joint; axes of the joints ``turned`` point the other way.
    """
    model = robot.model
    stand = stand or pin.SE3.Identity()
    gravity = text(stand.rotation @ model.gravity.linear)
    parts = [HEAD.format(gravity=gravity, scene=scene, stand=place(stand))]
    names = [rename(name) for name in robot.joint_names]
    for i in range(1, model.njoints):
        body = model.inertias[i]
        kind = "slide" if is_slide(model.joints[i]) else "hinge"
        axis = -axis_of(model, i) if names[i - 1] in turned else axis_of(model, i)
        parts.append(
            f'<body name="link{i}" {place(model.jointPlacements[i])}>\n'
            f'<joint name="{names[i - 1]}" type="{kind}" axis="{text(axis)}"/>\n'
            f'<inertial pos="{text(body.lever)}" mass="{float(body.mass)!r}" '
            f'fullinertia="{text(body.inertia[ROWS, COLUMNS])}"/>\n'
        )
    frame = model.frames[robot.frame_id].placement
    parts += [f'<site name="flange" {place(frame)}/>\n', inside, "</body>\n" * model.nv]
    actuators = "".join(f'<position joint="{name}" kp="500"/>' for name in names)
    parts.append(TAIL.format(actuators=actuators))
    path.write_text("".join(parts))
    return path
