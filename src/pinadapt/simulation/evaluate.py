"""From the raw record of a run to a rollout: truths, V(t), and the watched matrices."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..controller.controller import Controller
from ..laws.law import Truth
from ..plants.pinocchio_plant import PinocchioPlant
from ..records import Measurement
from ..rollout.rollout import Rollout
from .trace import Trace


def evaluate(
    trace: Trace,
    plant: PinocchioPlant,
    controller: Controller,
    *,
    title: str,
    adaptation: str,
    wall_time: float,
) -> Rollout:
    """Turn a trace into a rollout."""
    nq, nv, task = plant.robot.model.nq, plant.nv, plant.robot.task
    a_k_true, a_d_true = (
        controller.kinematics.value(plant.robot),
        controller.dynamics.value(plant.robot),
    )
    x, x_d = (
        _rows(rows, task.coordinates)
        for rows in (trace.true_x, [desired.x_d for desired in trace.desired])
    )
    eigenvalues, singulars, damping, V = _watch(trace, plant, controller, a_k_true, a_d_true)
    tau = _rows(trace.torques, nv)
    return Rollout(
        title=title,
        robot=plant.robot.name,
        law=controller.law.name,
        adaptation=adaptation,
        task=task.name,
        kinematic_names=controller.kinematics.names,
        dynamic_names=controller.dynamics.names,
        kinematic_base=controller.kinematics.base(),
        t=np.array(trace.t),
        q=_rows(trace.true_q, nq),
        v=_rows(trace.true_v, nv),
        tau=tau,
        x=x,
        x_d=x_d,
        error=_rows([task.error(*both) for both in zip(x, x_d, strict=True)], task.size),
        a_k=_rows([state.a_k for state in trace.states], controller.kinematics.size),
        a_d=_rows([state.a_d for state in trace.states], controller.dynamics.size),
        a_k_true=a_k_true,
        a_d_true=a_d_true,
        lyapunov=V,
        min_eig_M_hat=eigenvalues,
        min_singular_J_hat=singulars,
        damping=damping,
        damping_share=damping / np.maximum(singulars**2 + damping, np.finfo(float).tiny),
        saturated=_saturated(tau, plant.torque_limits, controller.limits.torque),
        diverged=trace.diverged,
        reason=trace.reason,
        wall_time=wall_time,
        step_time=trace.step_time / max(trace.steps, 1),
    )


def _rows(samples: list[np.ndarray], width: int) -> np.ndarray:
    return np.array(samples, dtype=float).reshape(len(samples), width)


def _saturated(tau: np.ndarray, *limits: np.ndarray | None) -> np.ndarray:
    """Tell of each sample (N) whether a torque (N, nv) is at one of the limits (nv) [N m or N]."""
    at = [(np.abs(tau) >= bounds).any(axis=1) for bounds in limits if bounds is not None]
    return np.any([np.zeros(len(tau), dtype=bool), *at], axis=0)


def _watch(
    trace: Trace,
    plant: PinocchioPlant,
    controller: Controller,
    a_k_true: np.ndarray | None,
    a_d_true: np.ndarray | None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray | None]:
    """Return the smallest eigenvalue of M_hat (N), the smallest singular value of J_hat (N), mu^2 (N), and V (N).

    V is None when a truth is unknown or a part of it undefined.
    """
    if not trace.t:
        return np.zeros(0), np.zeros(0), np.zeros(0), None
    M_hats, J_hats, damping, V = [], [], [], []
    for measurement, desired, state in zip(
        trace.measurements, trace.desired, trace.states, strict=True
    ):
        signals = controller.observe(state, measurement, desired)
        M_hats.append(controller.dynamics.mass_matrix(measurement.q))
        J_hats.append(controller.kinematics.J)
        damping.append(signals.inverse.damping)
        if a_k_true is None or a_d_true is None:
            continue
        part = controller.parameter_storage(state, a_k_true, a_d_true)
        if part is None:
            a_k_true = None  # undefined once is undefined for good
            continue
        V.append(
            part + controller.law.storage(signals, truth_at(plant, measurement, a_k_true, a_d_true))
        )
    eigenvalues = _smallest(np.linalg.eigvalsh, np.array(M_hats))
    singulars = _smallest(lambda J: np.linalg.svd(J, compute_uv=False), np.array(J_hats))
    return (
        eigenvalues,
        singulars,
        np.array(damping),
        np.array(V) if len(V) == len(trace.t) else None,
    )


def _smallest(values: Callable[[np.ndarray], np.ndarray], matrices: np.ndarray) -> np.ndarray:
    """Return the smallest value (N) of each matrix (N, ., .), NaN for those that are not finite."""
    finite = np.isfinite(matrices).all(axis=(1, 2))
    smallest = np.full(len(matrices), np.nan)
    smallest[finite] = values(matrices[finite]).min(axis=1)
    return smallest


def truth_at(
    plant: PinocchioPlant, measurement: Measurement, a_k_true: np.ndarray, a_d_true: np.ndarray
) -> Truth:
    """Return what a law's V needs to know of the true robot at one instant."""
    return Truth(a_k_true, a_d_true, plant.mass_matrix(measurement.q), plant.robot.friction)
