"""Identities of estimated kinematics at any estimate, against finite differences."""

import numpy as np
import pinocchio as pin

import pinadapt as pa
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


def check_motion(kinematics, state, a_k, a_k_rate, *, accuracy, rows=None):
    """Velocities, accelerations and regressors of kinematics, by finite differences.

    As many rows of xd_hat, by default all, are the derivative of x_hat. The kinematics stay at the
    state. Returned is the size of which rounding errors are a share.
    """
    q, v, a = state
    at = moving(kinematics, state, a_k, a_k_rate)
    p = kinematics.positions
    task = kinematics.task
    start = at(0.0).x_hat  # at its zero the error moves as x does
    xd = derivative(lambda t: task.error(at(t).x_hat, start))
    xdd = derivative(lambda t: at(t).xd_hat)
    Jdot = derivative(lambda t: at(t, 1.0).J)
    Jdot_v = derivative(lambda t: at(t).J) @ v
    at(0.0)
    size = 1.0 + np.abs(kinematics.J).max() * (1.0 + np.abs(v).max()) ** 2
    assert kinematics.J.shape == (task.size, v.size)
    assert np.allclose(kinematics.xd_hat[:rows], xd[:rows], atol=accuracy * size)
    assert np.allclose(kinematics.J @ v, kinematics.xd_hat, atol=1e-12 * size)
    assert np.allclose(kinematics.Jdot_v, Jdot_v, atol=10.0 * accuracy * size)
    of_second_order = min(100.0 * accuracy, 1e-6)
    assert np.allclose(kinematics.J @ a + kinematics.Jdot_v, xdd, atol=of_second_order * size)
    assert np.allclose(kinematics.jacobian_rate(a_k_rate), Jdot, atol=10.0 * accuracy * size)
    x, X_k = kinematics.at(q)
    assert np.allclose(X_k, kinematics.X_k, atol=1e-12 * size)
    assert np.allclose(x[:p], kinematics.p_hat, atol=1e-12 * size)
    return size


def check_kinematics(kinematics: pa.models.TaskKinematics) -> None:
    """Motion and regressors at another than the described estimate.

    Positions, velocities and accelerations are affine in the estimate: a step of it is no
    truncation. No other rows depend on it.
    """
    rng = np.random.default_rng(7)
    task = kinematics.task
    p = kinematics.positions
    q, v, a = random_state(kinematics.robot, rng)
    a_k = kinematics.initial + 0.2 * rng.standard_normal(kinematics.size)
    a_k_rate = rng.standard_normal(kinematics.size)
    check_motion(kinematics, (q, v, a), a_k, a_k_rate, accuracy=5e-11)
    X_k = kinematics.X_k
    Y_k = kinematics.Y_k
    Ybar_k = kinematics.acceleration_regressor(a)
    x = kinematics.x_hat
    xd = kinematics.xd_hat
    xdd = kinematics.J @ a + kinematics.Jdot_v
    assert X_k.shape == (p, kinematics.size) and np.array_equal(kinematics.Y_p, Y_k[:p])
    for regressor in (Y_k, Ybar_k):
        assert regressor.shape == (task.size, kinematics.size) and not regressor[p:].any()
    step = 0.1 * a_k_rate
    kinematics.update(a_k + step, q, v)
    moved = task.error(kinematics.x_hat, x)
    assert np.allclose(moved[:p], X_k @ step, atol=1e-12)
    assert np.abs(moved[p:]).max(initial=0.0) <= 1e-12
    assert np.allclose(kinematics.xd_hat - xd, Y_k @ step, atol=1e-12)
    assert np.allclose(kinematics.J @ a + kinematics.Jdot_v - xdd, Ybar_k @ step, atol=1e-11)
