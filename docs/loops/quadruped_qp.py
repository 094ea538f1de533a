"""A whole-body quadratic program on an A1, whose model learns the load on the trunk.

pip install "pinadapt[mujoco]" qpsolvers daqp; python quadruped_qp.py
"""

import matplotlib.pyplot as plt
import numpy as np
import pinocchio as pin
from qpsolvers import solve_qp

import pinadapt as pa

DT = 2e-3  # [s]
CONE = np.array([[1, 0, -0.5], [-1, 0, -0.5], [0, 1, -0.5], [0, -1, -0.5], [0, 0, -1]])  # C f <= 0
FEET = ["FL_foot", "FR_foot", "RL_foot", "RR_foot"]
ROBOT = pa.load("a1", base="free", contacts=FEET)  # six joints of the base before twelve of legs
TRUE = ROBOT.changed(payload=pa.Payload(8.0, com=(0.08, 0.03, 0.08)))  # nobody tells the controller


def torque(model: pin.Model, q: np.ndarray, v: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Return the torques (18) for a wanted acceleration of the base (6)."""
    data = model.createData()
    pin.forwardKinematics(model, data, q, v, np.zeros(18))
    M, h = pin.crba(model, data, q), pin.nonLinearEffects(model, data, q, v)
    ids, axes = [model.getFrameId(foot) for foot in FEET], pin.LOCAL_WORLD_ALIGNED
    J = np.vstack([pin.computeFrameJacobian(model, data, q, foot, axes)[:3] for foot in ids])
    drift = [pin.getFrameClassicalAcceleration(model, data, foot, axes).linear for foot in ids]
    H = np.diag([1.0] * 6 + [1e-4] * 12 + [1e-6] * 12)  # accelerations and forces of the feet
    A = np.block([[M[:6], -J[:, :6].T], [J, np.zeros((12, 12))]])
    b = np.concatenate([-h[:6], -np.concatenate(drift) - 20.0 * J @ v])
    C = np.hstack([np.zeros((20, 18)), np.kron(np.eye(4), CONE)])
    x = solve_qp(H, np.append(-wanted, np.zeros(24)), C, np.zeros(20), A, b, solver="daqp")
    return np.append(np.zeros(6), (M @ x[:18] + h - J.T @ x[18:])[6:])


def run(learn: bool, duration: float = 6.0) -> np.ndarray:
    """Return the distance (N) of the trunk from where it should be [m]."""
    plant, model, errors = pa.plants.MujocoPlant(TRUE), ROBOT.model, []
    plant.reset()
    measured, w, sway = plant.measure(), np.pi, 0.02 * np.array([1, 0, 1, 0, 3, 0])  # [m], [rad]
    estimator = pa.Estimator(ROBOT, unknown="payload", period=DT)
    state = estimator.init(measured)
    for k in range(round(duration / DT)):
        s, c, q, v = sway * np.sin(w * k * DT), sway * np.cos(w * k * DT), measured.q, measured.v
        off, rate = ROBOT.q0[:6] + s - q[:6], w * c - v[:6]
        tau = torque(model, q, v, 100.0 * off + 20.0 * rate - w * w * s)
        plant.step(tau, DT)
        measured = plant.measure()
        state = estimator.step(state, measured._replace(tau=tau))
        if learn and k % 50 == 49:  # ten times a second
            model = estimator.estimate(state).model
        errors.append(np.linalg.norm(off[:3]))
    return np.array(errors)


if __name__ == "__main__":
    for learn, label in ((False, "as described"), (True, "learned")):
        plt.plot(DT * np.arange(3000), 1e3 * run(learn), label=label)
    plt.xlabel("t [s]"), plt.ylabel("error of the trunk [mm]"), plt.legend()
    plt.savefig("quadruped_qp.png")
