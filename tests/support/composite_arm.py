"""The arm of Slotine and Li's paper on composite adaptation, as two bodies that move alike."""

import numpy as np
import pinocchio as pin

import pinadapt as pa

A = np.array([0.15, 0.04, 0.03, 0.025])  # kg m^2
K_D, LAMBDA = 3.0, 10.0 / 3.0
# The links' angles in the world are T times those of the joints: gains on them are T^T K_D T on the
# joints, torques of them T^-T times those of the joints, and gradients stay what they were.
T = np.array([[1.0, 0.0], [1.0, 1.0]])
WEIGHT = np.linalg.inv(T) @ np.linalg.inv(T).T  # of the joints' torques, for one of the links'


class Path(pa.trajectories.Trajectory):
    """q_d1 = pi/4 + 2 (1 - cos 3t), q_d2 = pi/6 + (1 - cos 5t) of the links, as joint angles."""

    def at(self, t):
        w = np.array([3.0, 5.0])
        size = np.array([2.0, 1.0])
        start = np.pi / np.array([4.0, 6.0])
        c = np.cos(w * t)
        s = np.sin(w * t)
        links = start + size * (1.0 - c), size * w * s, size * w * w * c
        return pa.Desired(*(np.linalg.solve(T, part) for part in links))


def tracked(adaptation, dt, seconds=4.0):
    """Return |e| (N, 2) of the links [degrees] and the estimates (N, 4).

    From nothing known, at rest on the path, with the gains of the paper.
    """
    true = pa.load("two_link", task="joint", q0=Path().at(0.0).x_d)
    mass = 0.05
    com = np.array([0.03, -0.025, 0.0]) / mass
    true.model.inertias[1] = pin.Inertia(0.01, np.zeros(3), np.diag([0.1, 0.1, 0.15 - mass]))
    about = 0.04 - mass * com @ com
    true.model.inertias[2] = pin.Inertia(mass, com, np.diag([about, about, about]))
    B = np.zeros((20, 4))
    B[[9, 19, 11, 12], [0, 1, 2, 3]] = 1.0, 1.0, 1.0, -1.0
    controller = pa.make_controller(
        true,
        law="slotine-li",
        adaptation=adaptation,
        unknown=pa.Unknown(basis=B),
        Kv=K_D * T.T @ T,
        alpha=LAMBDA,
    )
    assert np.allclose(controller.dynamics.initial, A)
    rollout = pa.simulate(
        true,
        controller,
        Path().as_given(),
        duration=seconds,
        engine=pa.Engine(dt=dt, continuous=True),
        start={"a_d": np.zeros(4)},
    )
    return np.degrees(np.abs(rollout.error @ T.T)), rollout.a_d
