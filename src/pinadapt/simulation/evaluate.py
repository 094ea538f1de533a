"""From the raw record of a run to a rollout: truths, V(t), and the watched matrices."""

from __future__ import annotations

import numpy as np

from ..controller import Controller, ControllerState
from ..laws import Truth
from ..rollout import Rollout
from ..signals import Measurement
from .plant import Plant
from .trace import Trace


def evaluate(trace: Trace, plant: Plant, controller: Controller, *, title: str, adaptation: str, wall_time: float) -> Rollout:
    """Turn a trace into a rollout."""
    nq, nv, m = plant.robot.model.nq, plant.nv, plant.robot.task.size
    a_k_true, a_d_true = controller.kinematics.value(plant.robot), controller.dynamics.value(plant.robot)
    x, x_d = _rows(trace.true_x, m), _rows([desired.x_d for desired in trace.desired], m)
    eigenvalues, singulars = _watched(trace, controller)
    return Rollout(
        title=title,
        robot=plant.robot.name,
        law=controller.law.name,
        adaptation=adaptation,
        kinematic_names=controller.kinematics.names,
        dynamic_names=controller.dynamics.names,
        t=np.array(trace.t),
        q=_rows(trace.true_q, nq),
        v=_rows(trace.true_v, nv),
        tau=_rows(trace.torques, nv),
        x=x,
        x_d=x_d,
        error=x - x_d,
        a_k=_rows([state.a_k for state in trace.states], controller.kinematics.size),
        a_d=_rows([state.a_d for state in trace.states], controller.dynamics.size),
        a_k_true=a_k_true,
        a_d_true=a_d_true,
        lyapunov=_lyapunov(trace, plant, controller, a_k_true, a_d_true),
        min_eig_M_hat=eigenvalues,
        min_singular_J_hat=singulars,
        diverged=trace.diverged,
        reason=trace.reason,
        wall_time=wall_time,
        step_time=trace.step_time / max(trace.steps, 1),
    )


def _rows(samples: list[np.ndarray], width: int) -> np.ndarray:
    return np.array(samples, dtype=float).reshape(len(samples), width)


def _watched(trace: Trace, controller: Controller) -> tuple[np.ndarray, np.ndarray]:
    """Return the smallest eigenvalue of M_hat (N) and the smallest singular value of J_hat (N)."""
    if not trace.t:
        return np.zeros(0), np.zeros(0)
    M_hats, J_hats = [], []
    for measurement, state in zip(trace.measurements, trace.states, strict=True):
        controller.kinematics.update(state.a_k, measurement.q, measurement.v)
        controller.dynamics.load(state.a_d)
        M_hats.append(controller.dynamics.mass_matrix(measurement.q))
        J_hats.append(controller.kinematics.J)
    return np.linalg.eigvalsh(np.array(M_hats))[:, 0], np.linalg.svd(np.array(J_hats), compute_uv=False)[:, -1]


def _lyapunov(
    trace: Trace, plant: Plant, controller: Controller, a_k_true: np.ndarray | None, a_d_true: np.ndarray | None
) -> np.ndarray | None:
    """Return V (N), or None when a truth is unknown or a part of V undefined."""
    if a_k_true is None or a_d_true is None:
        return None
    values = []
    for measurement, desired, state in zip(trace.measurements, trace.desired, trace.states, strict=True):
        part = parameter_storage(controller, state, a_k_true, a_d_true)
        if part is None:
            return None
        signals = controller.observe(state, measurement, desired)
        truth = truth_at(plant, measurement, a_k_true, a_d_true)
        values.append(controller.law.storage(signals, truth) + part)
    return np.array(values)


def truth_at(plant: Plant, measurement: Measurement, a_k_true: np.ndarray, a_d_true: np.ndarray) -> Truth:
    """Return what a law's V needs to know of the true robot at one instant."""
    return Truth(a_k_true, a_d_true, plant.mass_matrix(measurement.q))


def parameter_storage(
    controller: Controller, state: ControllerState, a_k_true: np.ndarray, a_d_true: np.ndarray
) -> float | None:
    """Return the parameters' part of V, or None where an adaptation leaves it undefined."""
    kinematic = controller.adaptation_k.distance(state.a_k, a_k_true)
    dynamic = controller.adaptation_d.distance(state.a_d, a_d_true)
    return None if kinematic is None or dynamic is None else kinematic + dynamic
