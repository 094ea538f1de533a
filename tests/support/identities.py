"""Identities of estimated kinematics at any estimate, against finite differences."""

import numpy as np
import pinocchio as pin

import pinadapt as pa
from pinadapt.models.translations import Translation
from tests.support.chains import random_state
from tests.support.differences import derivative


def unknown_choices(robot: pa.Robot) -> list[list[str]]:
    """Return four ways to declare translations unknown; one joint leaves only the tool's."""
    joints = robot.joint_names[1:]
    return [["tool"], ["lengths"], [*joints, "tool"], [*joints[:1], "tool:length"]]


def moving(kinematics, state, a_k, a_k_rate):
    """Return a function of time: kinematics in a motion with q, v, a at 0, learning at a rate."""
    q, v, a = state

    def at(t, rate=0.0):
        way = pin.integrate(kinematics.robot.model, q, v * t + a * (t * t / 2))
        kinematics.update(a_k + t * rate * a_k_rate, way, v + a * t)
        return kinematics

    return at


def check_motion(kinematics, state, a_k, a_k_rate, *, accuracy):
    """Velocities, accelerations and regressors of position kinematics, by finite differences.

    The kinematics stay at the state. Returned is the size of which rounding errors are a share.
    """
    q, v, a = state
    at, p = moving(kinematics, state, a_k, a_k_rate), kinematics.positions
    xd, xdd = derivative(lambda t: at(t).p_hat), derivative(lambda t: at(t).xd_hat)
    Jdot, Jdot_v = derivative(lambda t: at(t, 1.0).J), derivative(lambda t: at(t).J) @ v
    at(0.0)
    size = 1.0 + np.abs(kinematics.J).max() * (1.0 + np.abs(v).max()) ** 2
    assert np.allclose(kinematics.xd_hat[:p], xd, atol=accuracy * size)
    assert np.allclose(kinematics.J @ v, kinematics.xd_hat, atol=1e-12 * size)
    assert np.allclose(kinematics.Jdot_v, Jdot_v, atol=10.0 * accuracy * size)
    of_second_order = min(100.0 * accuracy, 1e-6)
    assert np.allclose(kinematics.J @ a + kinematics.Jdot_v, xdd, atol=of_second_order * size)
    assert np.allclose(kinematics.jacobian_rate(a_k_rate), Jdot, atol=10.0 * accuracy * size)
    x, X_k = kinematics.at(q)
    assert np.allclose(X_k, kinematics.X_k, atol=1e-12 * size)
    assert np.allclose(x[:p], kinematics.p_hat, atol=1e-12 * size)
    return size


def check_kinematics(robot: pa.Robot, unknown: list[str | Translation]) -> None:
    """J, Jdot_v, Y_k and others against finite differences at another than the own estimate."""
    rng = np.random.default_rng(7)
    believed = pa.models.FrameKinematics(robot, unknown)
    q, v, a = random_state(robot, rng)
    a_k = believed.initial + 0.2 * rng.standard_normal(believed.size)
    a_k_rate = rng.standard_normal(believed.size)

    at = moving(believed, (q, v, a), a_k, a_k_rate)
    task, start = robot.task, at(0.0).x_hat
    xd = derivative(
        lambda t: task.error(at(t).x_hat, start)
    )  # at its zero the error moves as x does
    xdd, Jdot = derivative(lambda t: at(t).xd_hat), derivative(lambda t: at(t, rate=1.0).J)
    Jdot_v = derivative(lambda t: at(t).J) @ v
    now = at(0.0)
    assert now.J.shape == (task.size, robot.model.nv)
    assert np.allclose(now.J @ v, xd, atol=1e-8)
    assert np.allclose(now.Y_k @ a_k + now.y_k0, now.J @ v, atol=1e-12)
    assert np.array_equal(now.Y_p, now.Y_k[: task.positions])
    assert np.allclose(now.Jdot_v, Jdot_v, atol=1e-7)
    assert np.allclose(now.J @ a + now.Jdot_v, xdd, atol=1e-7)
    assert np.allclose(now.jacobian_rate(a_k_rate), Jdot, atol=1e-7)
    x, xdd_now = now.x_hat, now.J @ a + now.Jdot_v
    position_regressor, acceleration_regressor = (
        now.X_k,
        now.acceleration_regressor(a),
    )
    assert position_regressor.shape == (task.positions, now.size)
    for regressor in (now.Y_k, acceleration_regressor):
        assert regressor.shape == (task.size, now.size) and not regressor[task.positions :].any()
    step = 0.1 * a_k_rate
    now.update(a_k + step, q, v)
    moved = task.error(now.x_hat, x)
    assert np.allclose(
        moved[: task.positions], position_regressor @ step, atol=1e-12
    )  # affine: no truncation in a large step
    assert np.abs(moved[task.positions :]).max(initial=0.0) <= 1e-12
    assert np.allclose(now.J @ a + now.Jdot_v - xdd_now, acceleration_regressor @ step, atol=1e-11)
