"""The online estimator on recorded motions, and on simulated arms whose loads come and go.

``pinadapt sweep benchmarks/estimator.toml`` measures all cases; the logs are those of
``real_logs.py``, in the folder that the environment variable ``REAL_LOGS`` names.

* real: raw samples of the first three quarters of a log; the error of the torques of the last
  quarter, by the robot that is saved, and that of ``identify``. With a shaft: the log of the robot
  whose last two joints turn one motor, which its description then says.
* coverage: a Panda with a random load, friction that the model does not have (it fades at other
  speeds, and gears add to it), 17-bit encoders without velocities, torque noise of 0.5 % of the
  limits, 8 s of a random motion: whether the 90 % intervals contain mass and centre.
* chains: every chain of the catalogue with a load of a tenth of its mass and friction of 2 % of the
  efforts, all joints swinging for 3 s.
* changes: a load is taken up after 6 s of motion; how long until it is found, and its error 1 s
  after that, with the arm known, and with all bodies unknown and a gripper announced as empty.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin

import pinadapt as pa
from pinadapt.identification.fits import Windows
from pinadapt.identification.logged_motion import motion_of_log
from pinadapt.information.measured_motion import Averages
from pinadapt.robot.changes import Friction, Shaft
from pinadapt.tasks.task import JointTask
from pinadapt.tuning.unknowns import Unknown, nominal_dynamics

from .real_logs import folder, logs_of

_QUANTILE = 1.645  # of the interval that contains a normal number nine times of ten


def measure(what: str, case: str, seed: int = 0) -> dict[str, Any]:
    """Return the figures of a case."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if what == "chains":
            return chain(*case.split(", "))
        if what == "real":
            return real(case.removesuffix(" with a shaft"), shaft=case.endswith("shaft"))
        return simulated(case, seed, change=what == "changes")


def real(name: str, *, shaft: bool) -> dict[str, Any]:
    """Return the held-out error of a log [N m], and the times of a step [ms]."""
    ((_, file, robot),) = logs_of(folder(), [name])
    robot = replace(robot, task=JointTask.of_joints(robot.model))
    if shaft:
        n = robot.model.nv
        friction = replace(robot.friction, shafts=(Shaft((n - 2, n - 1), 1),))
        robot = robot.changed(friction=friction)
    log = pa.read_log(file, robot)
    motion = motion_of_log(robot, log)
    split = float(motion.t[-1] - 0.25 * (motion.t[-1] - motion.t[0]))
    estimator = pa.Estimator(robot, period=log.period, held=False, smooth=True)
    q = log.configurations(robot)
    finite = np.isfinite(np.hstack([q, log.tau])).all(axis=1) & (log.t <= split)
    parts = (part[finite] for part in (log.t, q, log.tau))
    found, times = last(
        estimator,
        (
            pa.Measurement(t, q, 0.0 * q[: robot.model.nv], tau=tau)
            for t, q, tau in zip(*parts, strict=True)
        ),
    )
    nothing = Unknown(bodies="none", friction=False, armature=False)
    errors = []
    for each in (robot, found.robot):
        dynamics = nominal_dynamics(each, nothing, ())
        windows = Windows.of(motion, Averages(motion.t, log.period), dynamics)
        errors.append(float(np.sqrt(np.mean(windows.between(split, np.inf).y ** 2))))
    return {"described": errors[0], "online": errors[1], **times}


def last(
    estimator: pa.Estimator, samples: Iterator[pa.Measurement]
) -> tuple[Any, dict[str, float]]:
    """Return the estimate after samples, and the times of a step [ms]."""
    state, times = None, []
    for sample in samples:
        start = time.perf_counter()
        state = estimator.init(sample) if state is None else estimator.step(state, sample)
        times.append(1e3 * (time.perf_counter() - start))
    assert state is not None
    return estimator.estimate(state), {
        "step": float(np.median(times)),
        "mean": float(np.mean(times)),
        "longest": float(np.max(times)),
    }


def chain(name: str, unknown: str) -> dict[str, Any]:
    """Return how well a load is known that a chain of the catalogue carries."""
    rng, dt, robot = np.random.default_rng(0), 4e-3, pa.load(name)
    model, n = robot.model, robot.model.nv
    friction = 0.02 * np.clip(model.effortLimit, 0.01, 10.0)
    load = pa.Payload(0.1 * robot.mass, (0.0, 0.0, 0.02 * robot.reach))
    true = robot.changed(payload=load, viscous=friction, coulomb=friction)
    w, phase, data = rng.uniform(2.0, 8.0, n), rng.uniform(0.0, 6.0, n), true.model.createData()
    height = 0.3 * np.where([*robot.slides.values()], 0.2 * robot.reach, 1.0)
    estimator, state = pa.Estimator(robot, unknown, period=dt, held=False), None
    for t in np.arange(0.0, 3.0, dt).tolist():
        q = pin.integrate(model, robot.q0, height * np.sin(w * t + phase))
        v, a = height * w * np.cos(w * t + phase), -height * w**2 * np.sin(w * t + phase)
        tau = pin.rnea(true.model, data, q, v, a) + true.friction.torque(v)
        sample = pa.Measurement(t, q, v, tau=tau)
        state = estimator.init(sample) if state is None else estimator.step(state, sample)
    assert state is not None
    found = estimator.estimate(state).load
    assert found is not None
    error = found.mass - load.mass
    return {"mass_error": abs(error) / load.mass, "off": abs(error) / found.mass_known_to}


def random_load(rng: np.random.Generator) -> pa.Payload:
    """Return a box of 0.3 to 3 kg at the flange."""
    mass, sides = rng.uniform(0.3, 3.0), rng.uniform(0.03, 0.2, 3)
    moments = mass / 12.0 * (np.sum(sides**2) - sides**2)
    com = [*rng.uniform(-0.05, 0.05, 2), rng.uniform(0.0, 0.1)]
    return pa.Payload(mass, com, [moments[0], 0.0, moments[1], 0.0, 0.0, moments[2]])


def simulated(case: str, seed: int, *, change: bool) -> dict[str, Any]:
    """Return how well a load is known after a motion, or after it was taken up."""
    rng, dt = np.random.default_rng(seed), 4e-3
    robot, load = pa.load("panda", task="joint"), random_load(rng)
    viscous, coulomb = rng.uniform(0.2, 1.0, (2, 7))
    shape = {"gear_friction": 0.03, "breakaway": 1.3, "fading": 0.04}
    shaped: Any = {name: np.full(7, value) for name, value in shape.items()}
    friction = Friction(viscous, coulomb, **shaped)
    empty = robot.changed(friction=friction)
    true = empty.changed(payload=load)
    taken = 6.0 if change else 0.0
    t = np.arange(0.0, 8.0, dt)
    w = 2.0 * np.pi * rng.uniform(0.1, 0.5, (7, 3))
    phase, height = rng.uniform(0.0, 6.0, (7, 3)), rng.uniform(0.1, 0.25, (7, 3))
    angles = t[:, None, None] * w + phase
    q = robot.home_angles + (height * np.sin(angles)).sum(-1)
    v = (height * w * np.cos(angles)).sum(-1)
    a = -(height * w**2 * np.sin(angles)).sum(-1)
    limits, count = robot.model.effortLimit, 2.0 * np.pi / 2**17
    known = case == "payload"
    estimator = pa.Estimator(robot, case, period=dt, held=False, smooth=True)
    announced = {} if known or not change else {"payload": pa.Payload(0.0)}
    state, at = None, np.nan
    datas = {id(one): one.model.createData() for one in (empty, true)}
    for k, now in enumerate(t.tolist()):
        one = empty if now < taken else true
        g = pin.computeGeneralizedGravity(one.model, datas[id(one)], q[k])
        tau = pin.rnea(one.model, datas[id(one)], q[k], v[k], a[k])
        tau += one.friction.under(g).torque(v[k]) + 5e-3 * limits * rng.standard_normal(7)
        sample = pa.Measurement(now, np.round(q[k] / count) * count, 0.0 * tau, tau=tau)
        if state is None:
            state = estimator.init(sample, **announced)
        else:
            before, state = state, estimator.step(state, sample)
            if state.accepted[1] < before.accepted[1]:
                at = now - taken
        if change and now >= taken + 1.0 + 0.05:
            break
    assert state is not None
    found = estimator.estimate(state).load
    if found is None:
        return {"found": None}
    value, deviations = found.numbers
    off = np.abs(value - np.concatenate([[load.mass], load.com, load.inertia])) / deviations
    return {
        "found": at,
        "mass": load.mass,
        "mass_error": abs(found.mass / load.mass - 1.0),
        "mass_known_to": found.mass_known_to,
        "centre_error": float(np.linalg.norm(found.com - load.com)),
        "mass_inside": bool(off[0] <= _QUANTILE),
        "centre_inside": float(np.mean(off[1:4] <= _QUANTILE)),
        "inertia_inside": float(np.mean(off[4:] <= _QUANTILE)),
    }
