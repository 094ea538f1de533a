"""pink's inverse kinematics and the gravity torque of a model that learns its load.

pip install pinadapt pin-pink daqp; python pink_gravity.py
"""

import matplotlib.pyplot as plt
import numpy as np
import pink
import pinocchio as pin

import pinadapt as pa

DT = 1e-3  # [s]
STIFFNESS = np.array([300.0] * 4 + [50.0] * 3)  # [N m/rad]
DAMPING = 0.1 * STIFFNESS  # [N m s/rad]
ROBOT = pa.load("panda")
TRUE = ROBOT.changed(payload=pa.Payload(2.0, com=(0.02, 0.0, 0.08)))  # nobody tells the controller


def run(learn: bool, duration: float = 6.0) -> np.ndarray:
    """Return times (N) and errors of the hand (N) on a circle of 10 cm."""
    plant = pa.plants.PinocchioPlant(TRUE)
    plant.reset()
    measured = plant.measure()
    estimator = pa.Estimator(ROBOT, unknown="payload", period=DT)
    state = estimator.init(measured)
    model = ROBOT.model
    data = model.createData()
    hand = pink.FrameTask(ROBOT.frame, position_cost=1.0, orientation_cost=0.1, gain=0.5)
    posture = pink.PostureTask(cost=1e-3)
    desired = pink.Configuration(model, data.copy(), measured.q)  # its velocity limits are kept
    posture.set_target(measured.q)
    start = desired.get_transform_frame_to_world(ROBOT.frame)
    errors = []
    for k in range(round(duration / DT)):
        angle = 2.0 * np.pi * k * DT / 3.0
        place = start.translation + 0.1 * np.array([0.0, np.sin(angle), 1.0 - np.cos(angle)])
        hand.set_target(pin.SE3(start.rotation, place))
        rate = pink.solve_ik(desired, [hand, posture], DT, solver="daqp")
        desired.integrate_inplace(rate, DT)
        spring = STIFFNESS * pin.difference(model, measured.q, desired.q)
        gravity = pin.computeGeneralizedGravity(model, data, measured.q)
        torque = gravity + spring + DAMPING * (rate - measured.v)
        plant.step(torque, DT)
        measured = plant.measure()
        state = estimator.step(state, measured._replace(x=None, tau=torque))
        if learn and k % 100 == 99:  # ten times a second
            model = estimator.estimate(state).model
            data = model.createData()
        errors.append(np.linalg.norm(measured.x - place))
    print(estimator.estimate(state).load)
    return np.array(errors)


if __name__ == "__main__":
    for learn, label in ((False, "as described"), (True, "learned")):
        errors = run(learn)
        plt.plot(DT * np.arange(len(errors)), 1e3 * errors, label=label)
    plt.xlabel("t [s]"), plt.ylabel("error of the hand [mm]"), plt.legend()
    plt.savefig("pink_gravity.png")
