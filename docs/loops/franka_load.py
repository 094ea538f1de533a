"""A client of a Franka that finds the load, by moving a little, and sets it on the robot.

pip install "pinadapt[franka]"; python franka_load.py ADDRESS fr3.urdf
"""

import sys

import matplotlib.pyplot as plt
import numpy as np
import pylibfranka as franka

import pinadapt as pa

STIFFNESS = np.array([120.0] * 4 + [40.0] * 3)  # [N m/rad]
SWING = np.array([0.1, 0.1, 0.1, 0.15, 0.2, 0.2, 0.2])  # [rad]


def move(arm, estimator, state, duration: float = 6.0):
    """Swing all joints; return state and largest errors (N) [rad]. The robot adds gravity."""
    control, errors = arm.start_torque_control(), []
    seen, _ = control.readOnce()
    start, home, rates = seen.time.to_sec(), np.array(seen.q), np.arange(1.5, 5.0, 0.5)
    while (t := seen.time.to_sec() - start) < duration:
        target = home + SWING * np.sin(rates * t) * min(t, 1.0)
        error = target - np.array(seen.q)
        rate = SWING * rates * np.cos(rates * t) * min(t, 1.0) - np.array(seen.dq)
        control.writeOnce(franka.Torques((STIFFNESS * error + 0.1 * STIFFNESS * rate).tolist()))
        errors.append(np.abs(error).max())
        seen, _ = control.readOnce()
        sample = pa.Measurement(
            seen.time.to_sec(), np.array(seen.q), np.array(seen.dq), tau=np.array(seen.tau_J)
        )
        state = estimator.init(sample) if state is None else estimator.step(state, sample)
    last = franka.Torques([0.0] * 7)
    last.motion_finished = True
    control.writeOnce(last)
    return state, np.array(errors)


def run(address: str, urdf: str):
    """Return the load, and the errors before and after it was set."""
    arm = franka.Robot(address, franka.RealtimeConfig.kIgnore)
    seen = arm.read_once()
    hand = pa.Payload(seen.m_ee, seen.F_x_Cee, np.array(seen.I_ee)[[0, 1, 4, 2, 5, 8]])
    robot = pa.load(urdf, frame="link8", q0=seen.q).changed(payload=hand)
    estimator = pa.Estimator(robot, unknown="payload", period=1e-3)
    state, before = move(arm, estimator, None)
    load = estimator.estimate(state).load
    full = load.inertia[[0, 1, 3, 1, 2, 4, 3, 4, 5]]  # at the flange, in its axes
    arm.set_load(load.mass, load.com.tolist(), full.tolist())
    return load, before, move(arm, estimator, state)[1]


if __name__ == "__main__":
    load, *errors = run(*sys.argv[1:])
    print(load)
    for each, label in zip(errors, ("before", "with the load set"), strict=True):
        plt.plot(1e-3 * np.arange(len(each)), np.degrees(each), label=label)
    plt.xlabel("t [s]"), plt.ylabel("largest joint error [deg]"), plt.legend()
    plt.savefig("franka_load.png")
