"""Robots on joint tasks: true ones with a load, and motions that begin beside home."""

import numpy as np

import pinadapt as pa
from tests.support.chains import catalogue_robot, mixed_robot


def joint_robot(name):
    return mixed_robot("joint") if name == "mixed" else catalogue_robot(name, task="joint")


def loaded(robot):
    load = pa.Payload(1.0, [0.01, 0.0, 0.05], [0.01, 0.0, 0.01, 0.0, 0.0, 0.01])
    return robot.changed(payload=load)


def swinging(robot, by=0.05):
    """Return a motion of all joints that begins beside home; one passes half a turn."""
    n = robot.model.nv
    return pa.trajectories.Sinusoid(robot.home_angles + by, 0.3, np.linspace(2.0, 3.0, n))
