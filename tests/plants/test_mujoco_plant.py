"""The MuJoCo plant moves the same robot as the Pinocchio plant."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp

import pinadapt as pa
from pinadapt.description.chain import effort_limits, position_limits
from tests.support.chains import catalogue_robot as load

pytestmark = pytest.mark.slow

mujoco = pytest.importorskip("mujoco")  # pip install -e '.[dev]' brings it

# Revolute joints, prismatic and continuous ones about z and x, rotor inertias, inclined axes and an
# inertia that no body has, bodies without mass: MuJoCo's compiler would refuse the last two. Of a1,
# four legs begin at the base.
ROBOTS = ("panda", "scara", "pr2_left_arm", "massless", "a1")


def robot_named(name):
    """Return a robot of the catalogue, or a UR5 two of whose bodies have no mass."""
    if name != "massless":
        return pa.load(name, task="joint" if name == "a1" else None)
    model = load("ur5").model.copy()
    for joint in (2, 5):
        model.inertias[joint] = pin.Inertia.Zero()
    return pa.load(model, frame="tool0", q0=load("ur5").home_angles)


def drive(plant, torque, seconds, dt=1e-3):
    """Apply a torque, a function of time, to a plant; return the last ideal measurement."""
    for _ in range(round(seconds / dt)):
        plant.step(torque(plant.measure().t), dt)
    return plant.measure()


def check_alike(one, other, atol):
    """Check that two measurements agree."""
    for name in ("t", "q", "v", "x", "xd"):
        assert np.allclose(getattr(one, name), getattr(other, name), rtol=0.0, atol=atol), name


# --- the same robot in both engines ---


@pytest.mark.parametrize("name", ROBOTS)
def test_free_motion_is_that_of_pinocchio_to_integration_error(name):
    """MuJoCo's method of Runge and Kutta against the equation of motion of Pinocchio."""
    robot = robot_named(name)
    robot = robot.changed(viscous=0.05, armature=robot.model.armature + 0.01)
    plant = pa.plants.PinocchioPlant(robot)
    n = robot.model.nv
    y = np.zeros(2 * robot.model.nv)
    push = 10.0 * np.diag(plant.mass_matrix(robot.q0))

    def rates(t, y, tau):
        q = plant.integrate(robot.q0, y[:n])
        v = y[n:]
        return np.concatenate([v, plant.acceleration_at(q, v, tau)])

    for k in range(80):
        tau = push * np.cos(10.0 * 1e-3 * k)
        exact = solve_ivp(rates, (0.0, 1e-3), y, "DOP853", args=(tau,), rtol=1e-12, atol=1e-12)
        y = exact.y[:, -1]
    end = plant.measurement(plant.integrate(robot.q0, y[:n]), y[n:], 0.08)
    ends = drive(pa.plants.MujocoPlant(robot), lambda t: push * np.cos(10.0 * t), 0.08), end
    assert np.abs(ends[0].v).max() > 0.1
    check_alike(*ends, atol=1e-9)


# --- friction, stops and motors ---


def test_stops_hold_joints_at_full_torque():
    robot = load("panda").changed(viscous=5.0)
    lower, upper = position_limits(robot.model)
    for sign in (-1.0, 1.0):
        plant = pa.plants.MujocoPlant(robot)
        beyond = []
        for _ in range(2000):
            plant.step(sign * effort_limits(robot.model), 1e-3)
            q = plant.measure().q
            beyond.append(np.maximum(lower - q, q - upper))
        beyond = np.array(beyond)
        assert (beyond[-1] > -1e-3).sum() >= 4  # these joints lie at their stops
        assert np.abs(plant.measure().v[beyond[-1] > -1e-3]).max() < 1e-2
        assert beyond[-1].max() < 1e-3 and beyond.max() < 0.03  # after the impact, and in it
