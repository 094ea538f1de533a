"""The arm of Slotine and Li's paper on composite adaptation, in closed form, in absolute angles."""

from itertools import islice

import numpy as np
import pinocchio as pin

import pinadapt as pa

A = np.array([0.15, 0.04, 0.03, 0.025])  # kg m^2
K_D, LAMBDA = 3.0, 10.0 / 3.0


class ArmDynamics(pa.models.Dynamics):
    """a1 qdd1 + h qdd2 - h' qd2^2 = tau1, h qdd1 + a2 qdd2 + h' qd1^2 = tau2.

    h = a3 cos(q2 - q1) + a4 sin(q2 - q1), h' = a3 sin(q2 - q1) - a4 cos(q2 - q1).
    """

    def __init__(self):
        self.names, self.size, self.initial = ("a1", "a2", "a3", "a4"), 4, np.zeros(4)

    def load(self, a_d):
        self._a = a_d

    def _columns(self, q, u1, u2, w1, w2):
        """Return [u1, 0, h u2, ...], with products of velocities w in h'."""
        c, s = np.cos(q[1] - q[0]), np.sin(q[1] - q[0])
        return np.array(
            [
                [u1, 0.0, c * u2 - s * w2, s * u2 + c * w2],
                [0.0, u2, c * u1 + s * w1, s * u1 - c * w1],
            ]
        )

    def regressor(self, q, v, a):
        return self._columns(q, *a, *(v * v))

    def slotine_li(self, q, v, v_r, a_r):
        Y = self._columns(q, *a_r, *(v * v_r))
        return Y, Y @ self._a

    def torque(self, q, v, a):
        return self.regressor(q, v, a) @ self._a

    def mass_matrix(self, q):
        return np.stack([self.regressor(q, np.zeros(2), e) @ self._a for e in np.eye(2)], axis=1)

    def momentum(self, q, v):
        """M v, and -C^T v: the derivative of -v^T M v / 2 by q, (h v1 v2)' with its sign."""
        c, s = np.cos(q[1] - q[0]), np.sin(q[1] - q[0])
        rest = np.array([[0.0, 0.0, -s, c], [0.0, 0.0, s, -c]]) * (v[0] * v[1])
        return pa.models.Momentum(self._columns(q, *v, 0.0, 0.0), rest, np.zeros(2), np.zeros(2))

    def value(self, robot):
        return A


class ArmPlant:
    """The true arm, as ``run_continuous`` asks for one."""

    def __init__(self, robot):
        self.robot, self.nv, self._truth = robot, 2, ArmDynamics()
        self._truth.load(A)

    def integrate(self, q, dq):
        return q + dq

    def measurement(self, q, v, t=0.0):
        return pa.Measurement(t, q, v, x=q)

    def motors_at(self, q, torque):
        return torque

    def acceleration_at(self, q, v, torque, feedthrough=None):
        rest = self._truth.torque(q, v, np.zeros(2))
        return np.linalg.solve(self._truth.mass_matrix(q), torque - rest)


class Path(pa.trajectories.Trajectory):
    """q_d1 = pi/4 + 2 (1 - cos 3t), q_d2 = pi/6 + (1 - cos 5t)."""

    def at(self, t):
        w, size, start = np.array([3.0, 5.0]), np.array([2.0, 1.0]), np.pi / np.array([4.0, 6.0])
        c, s = np.cos(w * t), np.sin(w * t)
        return pa.Desired(start + size * (1.0 - c), size * w * s, size * w * w * c)


def tracked(adaptation, seconds=4.0, dt=1e-3):
    """Return |e| (N, 2) [degrees] and the estimates (N, 4) from nothing known, at rest on the path.

    The gains are those of the paper.
    """
    robot = pa.load("planar_2r", task="joint", q0=Path().at(0.0).x_d)
    dynamics = ArmDynamics()
    law = pa.laws.SlotineLi(robot.task, pa.laws.Posture.of(robot, None, 1.0), K_v=K_D, alpha=LAMBDA)
    plant = ArmPlant(robot)
    controller = pa.Controller(
        law,
        pa.models.JointKinematics(robot, ()),
        dynamics,
        adaptation_k=pa.adaptation.Frozen(),
        adaptation_d=adaptation,
    )
    samples = pa.simulation.run_continuous(plant, controller, Path(), dt=dt)
    run = list(islice(samples, round(seconds / dt)))
    errors = np.array([s.measurement.q - s.desired.x_d for s in run])
    return np.degrees(np.abs(errors)), np.array([s.state.a_d for s in run])


class JointPath(pa.trajectories.Trajectory):
    """The same motion as angles of the joints: the second is relative to the first link."""

    def at(self, t):
        return pa.Desired(*(np.array([a[0], a[1] - a[0]]) for a in Path().at(t)))


def tracked_bodies(gamma_d, seconds=4.0, dt=2.5e-3):
    """Return the same of an arm of two bodies that moves alike, under a gradient.

    The links' angles in the world are T times those of the joints: gains on them are T^T K_D T on
    the joints, and the gradient stays what it was.
    """
    true = pa.load("two_link", task="joint", q0=JointPath().at(0.0).x_d)
    mass, T = 0.05, np.array([[1.0, 0.0], [1.0, 1.0]])
    com = np.array([0.03, -0.025, 0.0]) / mass
    true.model.inertias[1] = pin.Inertia(0.01, np.zeros(3), np.diag([0.1, 0.1, 0.15 - mass]))
    about = 0.04 - mass * com @ com
    true.model.inertias[2] = pin.Inertia(mass, com, np.diag([about, about, about]))
    B = np.zeros((20, 4))
    B[[9, 19, 11, 12], [0, 1, 2, 3]] = 1.0, 1.0, 1.0, -1.0
    controller = pa.make_controller(
        true,
        law="slotine-li",
        adaptation="gradient",
        gamma_d=gamma_d,
        unknown=pa.Unknown(basis=B),
        Kv=K_D * T.T @ T,
        alpha=LAMBDA,
    )
    assert np.allclose(controller.dynamics.initial, A)
    rollout = pa.simulate(
        true,
        controller,
        JointPath().as_given(),
        duration=seconds,
        engine=pa.Engine(dt=dt, continuous=True),
        start={"a_d": np.zeros(4)},
    )
    return np.degrees(np.abs(rollout.error @ T.T)), rollout.a_d
