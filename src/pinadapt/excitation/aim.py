"""The unknown parameters, their prior, and the information gain to be expected of a motion.

With a prior covariance P of the parameters and the information matrix H of a motion, the expected
information gain is log det(1 + P H) / 2 nats (Lindley, *On a measure of the information provided by
an experiment*, 1956). Without a prior, maximising it is the D-optimal design of Swevers (1997).
P and H are taken in base parameters, the combinations of parameters that motion can identify.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from ..description.chain import effort_limits
from ..exceptions import ParameterError
from ..information.information import BLOCK, Excitation, Information
from ..models.base_parameters import base_parameters, independent_columns
from ..models.dynamics import Dynamics
from ..models.task_kinematics import TaskKinematics
from ..robot.robot import Robot
from ..tuning.defaults import prior_covariance

_TORQUE_NOISE = 0.01  # of the effort limit, or of the typical torque of a joint without one
_POSITION_NOISE = 1e-3  # of the reach
_TRANSLATION_PRIOR = 0.1  # of the reach: standard deviation of a translation
_SAMPLES, _SPREAD, _SPEED = 50, 0.5, 1.0  # random states [rad, rad/s, rad/s^2 or m]


@dataclass(frozen=True, eq=False)
class _Part:
    """Parameters (p) of one model: prior in base parameters, and noise of the measured signals."""

    names: tuple[str, ...]
    initial: np.ndarray
    chosen: np.ndarray  # (b) indices of the base parameters
    root: np.ndarray  # (b, b) L of the prior covariance L L^T of the base parameters
    noise: np.ndarray  # (n) of the signals of a row

    def gain(self, W: np.ndarray, rows: float) -> tuple[float, np.ndarray]:
        """Return the information gain [nat] and its derivative (N, n, p) by W.

        Args:
            W: (N, n, p) regressors.
            rows: number of measurements for which the N stand.
        """
        slope = np.zeros(W.shape)
        if not len(self.chosen):
            return 0.0, slope
        share = rows / len(W)
        scaled = W[:, :, self.chosen] / self.noise[:, None] @ self.root
        flat = scaled.reshape(-1, len(self.chosen))
        information = np.eye(len(self.chosen)) + share * (flat.T @ flat)
        by_scaled = share * np.linalg.solve(information, flat.T).T.reshape(scaled.shape)
        slope[:, :, self.chosen] = by_scaled @ self.root.T / self.noise[:, None]
        return 0.5 * float(np.linalg.slogdet(information)[1]), slope

    def information(self, W: np.ndarray, rows: float) -> Information:
        """Return the information of ``rows`` measurements, for which W (N, n, p) stand."""
        whitened = (W / self.noise[:, None]).reshape(W.shape[0] * W.shape[1], len(self.names))
        H, score = rows / max(len(W), 1) * (whitened.T @ whitened), np.zeros(len(self.names))
        return Information(
            self.names, self.initial, H, score, self.noise, round(rows * len(self.noise))
        )


class Aim:
    """The unknown parameters of a robot, to be identified from torques and frame positions.

    Attributes:
        dynamic, kinematic: numbers of combinations of parameters that any motion can identify.
    """

    def __init__(self, robot: Robot, dynamics: Dynamics, kinematics: TaskKinematics) -> None:
        """Take the nominal robot and its models.

        Raises:
            ParameterError: nothing is unknown, or no motion identifies any of it.
        """
        self._robot, self._dynamics, self._kinematics = robot, dynamics, kinematics
        if not dynamics.size + kinematics.size:
            raise ParameterError(
                "nothing is unknown, so there is nothing to excite.",
                where="unknown",
                hint='Name bodies ("all", "payload", joints) or translations ("tool", joints).',
            )
        dynamics.load(dynamics.initial)
        self._torque = _torque_part(robot, dynamics)
        self._position = _position_part(robot, kinematics)
        self.dynamic, self.kinematic = len(self._torque.chosen), len(self._position.chosen)
        if not self.dynamic + self.kinematic:
            names = ", ".join((*dynamics.names, *kinematics.names)[:10])
            raise ParameterError(
                f"no motion of '{robot.name}' from its base to '{robot.frame}' identifies any of "
                f"the unknown parameters ({names}).",
                where="unknown",
                hint="Name bodies further out; pinadapt.base_parameters returns the identifiable "
                "combinations.",
            )

    def information_gain(
        self, q: np.ndarray, v: np.ndarray, a: np.ndarray, duration: float
    ) -> float:
        """Return the expected information gain [nat] of N states (N, .) over a duration [s]."""
        rows = duration / BLOCK
        torque, _ = self._torque.gain(self._regressors(q, v, a), rows)
        position, _ = self._position.gain(self._position_regressors(q), rows)
        return torque + position

    def gain_and_changes(
        self, q: np.ndarray, v: np.ndarray, a: np.ndarray, duration: float, first: int
    ) -> tuple[float, np.ndarray]:
        """Return the gain [nat] of the first states, and its change when one of them is replaced.

        The other states are k blocks, each with a replacement for every one of the first. The
        changes (k first) are to first order, of one replacement at a time.
        """
        rows, changes = duration / BLOCK, np.zeros(len(q) - first)
        total = 0.0
        for part, W in (
            (self._torque, self._regressors(q, v, a)),
            (self._position, self._position_regressors(q)),
        ):
            if not W.size:
                continue
            gain, slope = part.gain(W[:first], rows)
            others = W[first:].reshape(-1, *W[:first].shape)
            changes += np.einsum("tij,ktij->kt", slope, others - W[:first]).ravel()
            total += gain
        return total, changes

    def excitation(
        self, q: np.ndarray, v: np.ndarray, a: np.ndarray, duration: float
    ) -> Excitation:
        """Return the information of N states (N, .), spread over a duration [s]."""
        rows, dynamics = duration / BLOCK, self._dynamics
        units: Mapping[str, str] = {name: "m" for name in self._kinematics.names} | dict(
            zip(dynamics.names, dynamics.units, strict=True)
        )
        return Excitation(
            self._torque.information(self._regressors(q, v, a), rows),
            self._position.information(self._position_regressors(q), rows),
            units,
        )

    def _regressors(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return the regressors Y (N, n, p) of the torques."""
        shape = len(q), self._robot.model.nv, self._dynamics.size
        if not self._dynamics.size:
            return np.zeros(shape)
        return np.array([self._dynamics.regressor(*z) for z in zip(q, v, a, strict=True)])

    def _position_regressors(self, q: np.ndarray) -> np.ndarray:
        """Return dx/da_k (N, m, p) of the positions."""
        kinematics = self._kinematics
        if not kinematics.size:
            return np.zeros((len(q), kinematics.positions, 0))
        kinematics.update(kinematics.initial, q[0], np.zeros(kinematics.nv))
        return np.array([kinematics.at(each)[1] for each in q])


def _torque_part(robot: Robot, dynamics: Dynamics) -> _Part:
    """Return the dynamic parameters; prior: inertias within 30 %, coefficients typical ones."""
    base, (typical, Y) = base_parameters(dynamics, robot), _typical(robot, dynamics)
    efforts = effort_limits(robot.model)
    noise = _TORQUE_NOISE * np.where(
        np.isfinite(efforts), efforts, np.maximum(typical, typical.max())
    )
    sizes = np.sqrt(np.mean(Y**2, axis=(0, 1)))
    scale = np.sqrt(np.mean(typical**2)) / np.where(sizes > 0.0, sizes, np.inf)
    prior = _dynamic_prior(robot, dynamics)
    R = base.regrouping
    covariance = np.diag(scale[base.chosen] ** 2) if prior is None else R @ prior @ R.T
    return _Part(tuple(dynamics.names), dynamics.initial, base.chosen, _root(covariance), noise)


def _dynamic_prior(robot: Robot, dynamics: Dynamics) -> np.ndarray | None:
    """Return the prior covariance (p, p) of the dynamic parameters, None where there is none."""
    size = dynamics.inertial.size
    inertial = prior_covariance(robot, dynamics) if size else np.zeros((0, 0))
    if inertial is None:
        return None
    covariance = np.diag(dynamics.typical**2)
    covariance[:size, :size] = inertial
    return covariance


def _position_part(robot: Robot, kinematics: TaskKinematics) -> _Part:
    """Return the kinematic parameters; prior: each within a tenth of the reach."""
    rng, m, size = np.random.default_rng(0), kinematics.positions, kinematics.size
    rows = [np.zeros((0, size))]
    for _ in range(_SAMPLES if size else 0):
        q = pin.integrate(robot.model, robot.q0, rng.uniform(-np.pi, np.pi, robot.model.nv))
        kinematics.update(kinematics.initial, q, np.zeros(robot.model.nv))
        rows.append(kinematics.X_k)
    chosen, R = independent_columns(np.vstack(rows))
    root = _TRANSLATION_PRIOR * robot.reach * _root(R @ R.T)
    noise = np.full(m, _POSITION_NOISE * robot.reach)
    return _Part(tuple(kinematics.names), kinematics.initial, chosen, root, noise)


def _typical(robot: Robot, dynamics: Dynamics) -> tuple[np.ndarray, np.ndarray]:
    """Return rms torques (n) over random states around home, and Y (N, n, p) at these."""
    model, data, rng = robot.model, robot.model.createData(), np.random.default_rng(0)
    torques, regressors = [], []
    for _ in range(_SAMPLES):
        q = pin.integrate(model, robot.q0, rng.uniform(-_SPREAD, _SPREAD, model.nv))
        v, a = _SPEED * rng.standard_normal((2, model.nv))
        torques.append(pin.rnea(model, data, q, v, a))
        regressors.append(dynamics.regressor(q, v, a))
    return np.sqrt(np.mean(np.square(torques), axis=0)), np.array(regressors)


def _root(covariance: np.ndarray) -> np.ndarray:
    """Return an L with covariance = L L^T."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
