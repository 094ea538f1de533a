"""A sampling controller that predicts with MuJoCo, whose ``MjModel`` gets the learned load.

pip install "pinadapt[mujoco]"; python mujoco_sampling.py
"""

import matplotlib.pyplot as plt
import mujoco
import numpy as np

import pinadapt as pa

DT, HORIZON, SAMPLES = 0.01, 25, 40  # [s], steps that are predicted, torques that are tried
ROBOT = pa.load("planar_2r", gravity=[0.0, -9.81, 0.0], task="joint")
SPREAD = np.array([4.0, 2.0])  # [N m] of the changes
TRUE = ROBOT.changed(payload=pa.Payload(2.0))  # nobody tells the controller


def predicted_cost(model, data, measured, torques, target) -> float:
    """Return the cost of a sequence of torques (HORIZON, 2)."""
    data.qpos[:], data.qvel[:], cost = measured.q, measured.v, 0.0
    for torque in torques:
        data.qfrc_applied[:] = torque
        mujoco.mj_step(model, data)
        cost += np.sum((data.qpos - target) ** 2) + 0.01 * np.sum(data.qvel**2)
    return cost


def run(learn: bool, duration: float = 8.0) -> np.ndarray:
    """Return the largest joint error (N) of each sample [rad]; the target changes every 2 s."""
    model = mujoco.MjModel.from_xml_string(ROBOT.mjcf())
    model.opt.timestep, data, rng = DT, mujoco.MjData(model), np.random.default_rng(0)
    best, errors, plant = np.zeros((HORIZON, 2)), [], pa.plants.MujocoPlant(TRUE)
    plant.reset()
    measured = plant.measure()
    estimator = pa.Estimator(ROBOT, unknown="payload", period=DT)
    state = estimator.init(measured)
    for k in range(round(duration / DT)):
        target = ROBOT.q0 + (0.5 if k % 400 < 200 else -0.5)
        change = rng.normal(size=(SAMPLES, 1, 2)) + 0.5 * rng.normal(size=(SAMPLES, HORIZON, 2))
        tried = np.vstack([best[1:], best[-1:]]) + SPREAD * change
        costs = np.array([predicted_cost(model, data, measured, each, target) for each in tried])
        weights = np.exp(-10.0 * (costs - costs.min()) / costs.std())
        best = np.tensordot(weights / weights.sum(), tried, 1)
        plant.step(best[0], DT)
        measured = plant.measure()
        state = estimator.step(state, measured._replace(tau=best[0]))
        if learn and k % 10 == 9:  # ten times a second
            estimator.estimate(state).write(model)
        errors.append(np.abs(target - measured.q).max())
    print(estimator.estimate(state).load)
    return np.array(errors)


if __name__ == "__main__":
    for learn, label in ((False, "as described"), (True, "learned")):
        errors = run(learn)
        plt.plot(DT * np.arange(len(errors)), np.degrees(errors), label=label)
    plt.xlabel("t [s]"), plt.ylabel("largest joint error [deg]"), plt.legend()
    plt.savefig("mujoco_sampling.png")
