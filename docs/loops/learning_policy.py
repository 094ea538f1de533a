"""A policy of joint targets at 50 Hz, with a PD loop whose gravity compensation learns the load.

pip install pinadapt; python learning_policy.py
"""

import matplotlib.pyplot as plt
import numpy as np
import pinocchio as pin

import pinadapt as pa

DT, PERIOD = 1e-3, 0.02  # [s] of the PD loop, of the policy
ROBOT = pa.load("z1", task="joint")
TRUE = ROBOT.changed(payload=pa.Payload(1.2, com=(0.03, 0.0, 0.02)))  # nobody tells the controller


def policy(t: float) -> np.ndarray:
    """Return joint targets; a trained network takes this place, with what it observes."""
    return ROBOT.q0 + 0.3 * np.sin(np.arange(1, 7) * 0.5 * t) * [1.0, 0.5, 0.5, 1.0, 1.0, 1.0]


def run(learn: bool, duration: float = 10.0) -> np.ndarray:
    """Return the largest joint error (N) of each sample [rad]."""
    plant = pa.plants.PinocchioPlant(TRUE)
    plant.reset()
    measured, model = plant.measure(), ROBOT.model
    data = model.createData()
    stiffness = 80.0 * np.diag(pin.crba(model, data, measured.q)) + 10.0  # [N m/rad]
    estimator = pa.Estimator(ROBOT, unknown="payload", period=DT)
    state, wanted, errors = estimator.init(measured), ROBOT.q0, []
    for k in range(round(duration / DT)):
        if k % round(PERIOD / DT) == 0:
            target, wanted = wanted, policy(measured.t + PERIOD)
            rate = (wanted - target) / PERIOD
        target = target + rate * DT
        gravity = pin.computeGeneralizedGravity(model, data, measured.q)
        torque = (
            gravity + stiffness * (target - measured.q) + 0.15 * stiffness * (rate - measured.v)
        )
        plant.step(torque, DT)
        measured = plant.measure()
        state = estimator.step(state, measured._replace(tau=torque))
        if learn and k % 100 == 99:  # ten times a second
            model = estimator.estimate(state).model
            data = model.createData()
        errors.append(np.abs(target - measured.q).max())
    print(estimator.estimate(state).load)
    return np.array(errors)


if __name__ == "__main__":
    for learn, label in ((False, "as described"), (True, "learned")):
        errors = run(learn)
        plt.plot(DT * np.arange(len(errors)), np.degrees(errors), label=label)
    plt.xlabel("t [s]"), plt.ylabel("largest joint error [deg]"), plt.legend()
    plt.savefig("learning_policy.png")
