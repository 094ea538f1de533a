"""Quantities of a recorded run: V(t), and the estimated mass matrix and Jacobian."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np

from ..controller.controller import Controller
from ..controller.state import ControllerState, Sample
from ..description.chain import effort_limits
from ..exceptions import ParameterError
from ..laws.law import Truth
from ..plants.pinocchio_plant import PinocchioPlant
from ..robot.robot import Robot
from ..robot.succession import Succession
from .limit_excess import LimitExcess, motion_of_plant, motion_of_reference


class Evaluation:
    """Quantities of N recorded samples, each computed at its first use and then stored.

    Attributes:
        controller: that ran; its private models are overwritten by the computations.
        true: the robot that was driven, and the ones that it became during the run.
        samples: what was recorded (N).
    """

    def __init__(self, controller: Controller, true: Succession, samples: Sequence[Sample]) -> None:
        """Take what the quantities are computed from."""
        self.controller, self.true, self.samples = controller, true, samples

    @property
    def last_state(self) -> ControllerState:
        """The controller's state at the last sample.

        Raises:
            ParameterError: there is no sample, or its estimates are not finite.
        """
        if not self.samples:
            raise ParameterError("the run has no sample, so there is no estimate.", where="rollout")
        state = self.samples[-1].state
        if not (np.isfinite(state.a_d).all() and np.isfinite(state.a_k).all()):
            raise ParameterError("the last estimates are not finite.", where="rollout")
        return state

    @cached_property
    def a_k_true(self) -> np.ndarray | None:
        """The true kinematic parameters [m], as ``Rollout`` has them."""
        return self._in_time(self._true_k)

    @cached_property
    def a_d_true(self) -> np.ndarray | None:
        """The true dynamic parameters, as ``Rollout`` has them."""
        return self._in_time(self._true_d)

    @cached_property
    def _true_k(self) -> list[np.ndarray] | None:
        """The true kinematic parameters (p_k) of each robot, or None where one has none."""
        return self._of_all(self.controller.kinematics.value)

    @cached_property
    def _true_d(self) -> list[np.ndarray] | None:
        """The true dynamic parameters (p_d) of each robot, or None where one has none."""
        return self._of_all(self.controller.dynamics.value)

    def _of_all(self, value: Callable[[Robot], np.ndarray | None]) -> list[np.ndarray] | None:
        if not self.true.known:
            return None
        values = [value(robot) for robot in self.true.robots]
        known = [part for part in values if part is not None]
        return known if len(known) == len(values) else None

    def _in_time(self, values: list[np.ndarray] | None) -> np.ndarray | None:
        """Return the one value (p), or those of all samples (N, p) where there are several."""
        if values is None or len(values) == 1:
            return None if values is None else values[0]
        return np.array(values)[self._phases(self.samples)]

    def _phases(self, samples: Sequence[Sample]) -> np.ndarray:
        """Return the index of the true robot at each of the samples (k)."""
        return self.true.index(np.array([sample.t for sample in samples]))

    @cached_property
    @np.errstate(all="ignore")  # a loop that diverges overflows
    def smallest_eigenvalues(self) -> np.ndarray:
        """Smallest eigenvalue (N) of the estimated mass matrix; NaN where that is not finite."""
        dynamics, project, M = self.controller.dynamics, self.controller.adaptation_d.project, []
        for sample in self.samples:
            q = sample.measurement.q
            dynamics.load(project(sample.state.dynamic, q))
            M.append(dynamics.mass_matrix(q))
        return _of_finite(np.linalg.eigvalsh, M).min(axis=1, initial=np.inf)

    @cached_property
    @np.errstate(all="ignore")
    def singular_values(self) -> np.ndarray:
        """Singular values (N, m) of the estimated Jacobian, descending; NaN where not finite."""
        kinematics, J = self.controller.kinematics, []
        for sample in self.samples:
            kinematics.update(sample.state.a_k, sample.measurement.q, sample.measurement.v)
            J.append(kinematics.J)
        return _of_finite(lambda stack: np.linalg.svd(stack, compute_uv=False), J)

    @cached_property
    def smallest_singular_values(self) -> np.ndarray:
        """Smallest singular value (N) of the estimated Jacobian."""
        return self.singular_values.min(axis=1, initial=np.inf)

    @cached_property
    @np.errstate(all="ignore")
    def damping(self) -> np.ndarray:
        """The mu^2 (N) of the estimated Jacobian's right inverse, as ``RightInverse`` has it."""
        threshold = self.controller.limits.singular
        s_squared = 1.0 / np.sum(self.singular_values**-2.0, axis=1)
        return np.maximum(0.5 * (threshold**2 - s_squared), 0.0)

    @property
    def effort_limits(self) -> np.ndarray:
        """The description's effort limits (nv) [N m or N], infinite where it has none."""
        return effort_limits(self.true.robots[0].model)

    @cached_property
    def limits(self) -> LimitExcess:
        """By how much the true robot, and the reference of its joints, exceed their limits."""
        true, samples = self.true.robots[0], self.samples
        return LimitExcess.of(
            true, motion_of_plant(true, samples), motion_of_reference(true, samples)
        )

    @cached_property
    def lyapunov(self) -> np.ndarray | None:
        """V(t) (N), or None where a truth is unknown or an adaptation has no part of V for it."""
        return self.storage(self.samples)

    @np.errstate(all="ignore")
    def storage(self, samples: Sequence[Sample]) -> np.ndarray | None:
        """Return V at some of the samples (k), or None where it is undefined for one of them."""
        if self._true_k is None or self._true_d is None or not samples:
            return None
        plants = [PinocchioPlant(robot) for robot in self.true.robots]
        law, V = self.controller.law, []
        for sample, k in zip(samples, self._phases(samples), strict=True):
            plant, a_k, a_d = plants[k], self._true_k[k], self._true_d[k]
            parts = self.controller.parameter_storage(sample.state, a_k, a_d)
            if parts is None:
                return None
            signals = self.controller.observe(sample.state, sample.measurement, sample.desired)
            V.append(parts + law.storage(signals, truth_at(plant, sample, a_k, a_d)))
        return np.array(V)


def truth_at(
    plant: PinocchioPlant, sample: Sample, a_k_true: np.ndarray, a_d_true: np.ndarray
) -> Truth:
    """Return the quantities of the true robot at one sample on which a law's V depends."""
    q, v = sample.measurement.q, sample.measurement.v
    M, C = plant.mass_matrix(q), plant.coriolis_matrix(q, v)
    return Truth(a_k_true, a_d_true, M, C, plant.robot.friction)


def _of_finite(
    values: Callable[[np.ndarray], np.ndarray], matrices: Sequence[np.ndarray]
) -> np.ndarray:
    """Return min(m, n) values of each matrix (N, m, n), NaN for matrices that are not finite."""
    if not len(matrices):
        return np.zeros((0, 0))
    stack = np.array(matrices)
    finite = np.isfinite(stack).all(axis=(1, 2))
    result = np.full((len(stack), min(stack.shape[1:])), np.nan)
    result[finite] = values(stack[finite])
    return result
