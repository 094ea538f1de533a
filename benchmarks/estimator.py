"""The online estimator on recorded motions, and on simulated arms with loads.

``pinadapt sweep benchmarks/estimator.toml`` measures all cases; the logs are those of
``real_logs.py``, in the folder that the environment variable ``REAL_LOGS`` names.

* real: raw samples of the first three quarters of a log; the error of the torques of the last
  quarter, by the robot that is saved.
* coverage: a Panda with a random load, friction that the model does not have (it fades at other
  speeds, and gears add to it), 17-bit encoders without velocities, torque noise of 0.5 % of the
  limits, 8 s of a random motion: whether the 90 % intervals contain mass, centre and inertia.
* chains: every chain of the catalogue with a load of a tenth of its mass and friction of 2 % of the
  efforts, all joints swinging for 3 s.
"""

from __future__ import annotations

from collections.abc import Iterable
from time import perf_counter
from typing import Any

import numpy as np
import pinocchio as pin

import pinadapt as pa
from pinadapt.identification.estimator import Estimate
from pinadapt.robot.changes import Friction

from .estimators import problem_of
from .real_logs import folder, logs_of
from .shared import COUNT, quiet

_QUANTILE = 1.645  # of the interval that contains a normal number nine times of ten


@quiet()
def measure(what: str, case: str, seed: int = 0) -> dict[str, Any]:
    """Return the figures of a case."""
    if what == "chains":
        return chain(*case.split(", "))
    return real(case) if what == "real" else coverage(case, seed)


def last(
    estimator: pa.Estimator, samples: Iterable[pa.Measurement]
) -> tuple[Estimate, list[float]]:
    """Return the estimate after samples, and the time of each step [s]."""
    state = None
    times = []
    for sample in samples:
        start = perf_counter()
        state = estimator.init(sample) if state is None else estimator.step(state, sample)
        times.append(perf_counter() - start)
    assert state is not None
    return estimator.estimate(state), times


def real(name: str) -> dict[str, Any]:
    """Return the held-out error of a log [N m], and the longest step [s]."""
    ((_, file, robot),) = logs_of(folder(), name)
    at = problem_of(pa.read_log(file, robot), robot)
    q = at.log.configurations(at.robot)
    tau = at.log.tau
    finite = np.isfinite(np.hstack([q, tau])).all(axis=1) & (at.log.t <= at.split)
    estimator = pa.Estimator(at.robot, period=at.log.period, held=False, smooth=True)
    found, times = last(
        estimator,
        [
            pa.Measurement(at.log.t[k], q[k], np.zeros(at.robot.model.nv), tau=tau[k])
            for k in np.flatnonzero(finite)
        ],
    )
    return {"online": at.rms_of(found.robot), "longest": max(times)}


def chain(name: str, unknown: str) -> dict[str, Any]:
    """Return how well a load is known that a chain of the catalogue carries."""
    rng = np.random.default_rng(0)
    dt = 4e-3
    robot = pa.load(name)
    model = robot.model
    n = robot.model.nv
    friction = 0.02 * np.clip(model.effortLimit, 0.01, 10.0)
    load = pa.Payload(0.1 * robot.mass, (0.0, 0.0, 0.02 * robot.reach))
    true = robot.changed(payload=load, viscous=friction, coulomb=friction)
    w = rng.uniform(2.0, 8.0, n)
    phase = rng.uniform(0.0, 6.0, n)
    data = true.model.createData()
    height = 0.3 * np.where([*robot.slides.values()], 0.2 * robot.reach, 1.0)
    samples = []
    for t in np.arange(0.0, 3.0, dt).tolist():
        q = pin.integrate(model, robot.q0, height * np.sin(w * t + phase))
        v = height * w * np.cos(w * t + phase)
        a = -height * w**2 * np.sin(w * t + phase)
        tau = pin.rnea(true.model, data, q, v, a) + true.friction.torque(v)
        samples.append(pa.Measurement(t, q, v, tau=tau))
    found = last(pa.Estimator(robot, unknown, period=dt, held=False), samples)[0].load
    assert found is not None
    return {"mass_error": abs(found.mass - load.mass) / load.mass}


def random_load(rng: np.random.Generator) -> pa.Payload:
    """Return a box of 0.3 to 3 kg at the flange."""
    mass = rng.uniform(0.3, 3.0)
    sides = rng.uniform(0.03, 0.2, 3)
    moments = mass / 12.0 * (np.sum(sides**2) - sides**2)
    com = [*rng.uniform(-0.05, 0.05, 2), rng.uniform(0.0, 0.1)]
    return pa.Payload(mass, com, [moments[0], 0.0, moments[1], 0.0, 0.0, moments[2]])


def coverage(unknown: str, seed: int) -> dict[str, Any]:
    """Return whether the intervals contain a load, of centre and inertia the share of them."""
    rng = np.random.default_rng(seed)
    dt = 4e-3
    robot = pa.load("panda", task="joint")
    load = random_load(rng)
    viscous, coulomb = rng.uniform(0.2, 1.0, (2, 7))
    shape = {"gear_friction": 0.03, "breakaway": 1.3, "fading": 0.04}
    shaped: Any = {name: np.full(7, value) for name, value in shape.items()}
    true = robot.changed(friction=Friction(viscous, coulomb, **shaped)).changed(payload=load)
    t = np.arange(0.0, 8.0, dt)
    w = 2.0 * np.pi * rng.uniform(0.1, 0.5, (7, 3))
    phase = rng.uniform(0.0, 6.0, (7, 3))
    height = rng.uniform(0.1, 0.25, (7, 3))
    angles = t[:, None, None] * w + phase
    q = robot.home_angles + (height * np.sin(angles)).sum(-1)
    v = (height * w * np.cos(angles)).sum(-1)
    a = -(height * w**2 * np.sin(angles)).sum(-1)
    limits = robot.model.effortLimit
    data = true.model.createData()
    samples = []
    for k, now in enumerate(t.tolist()):
        g = pin.computeGeneralizedGravity(true.model, data, q[k])
        tau = pin.rnea(true.model, data, q[k], v[k], a[k])
        tau += true.friction.under(g).torque(v[k]) + 5e-3 * limits * rng.standard_normal(7)
        read = np.round(q[k] / COUNT[17]) * COUNT[17]
        samples.append(pa.Measurement(now, read, 0.0 * tau, tau=tau))
    estimator = pa.Estimator(robot, unknown, period=dt, held=False, smooth=True)
    found = last(estimator, samples)[0].load
    assert found is not None
    value, deviations = found.numbers
    inside = (
        np.abs(value - np.concatenate([[load.mass], load.com, load.inertia]))
        <= _QUANTILE * deviations
    )
    return {
        "mass_inside": bool(inside[0]),
        "centre_inside": float(np.mean(inside[1:4])),
        "inertia_inside": float(np.mean(inside[4:])),
    }
