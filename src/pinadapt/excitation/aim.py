"""What is unknown, how much of it, and what a motion would tell of it.

With a prior covariance P of the parameters and the information matrix H of a motion, the data are
expected to tell log det(1 + P H) / 2 nats (Lindley, *On a measure of the information provided by an
experiment*, 1956): the D-optimal design of Swevers (1997) where nothing is known before, in units
that count nothing twice. Both are taken in base parameters, the combinations that motion shows.
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

_NOISE = 0.01  # of a torque, in parts of the effort limit or of a typical torque
_SEEN, _AWAY = 1e-3, 0.1  # of the reach: noise of a position, and error of a translation
_SAMPLES, _SPREAD, _SPEED = 50, 0.5, 1.0  # random states [rad, rad/s, rad/s^2 or m]


@dataclass(frozen=True, eq=False)
class _Part:
    """Parameters (p) of one model: prior in base parameters, and noise of what shows them."""

    names: tuple[str, ...]
    initial: np.ndarray
    chosen: np.ndarray  # (b) indices of the base parameters
    root: np.ndarray  # (b, b) L of the prior covariance L L^T of the base parameters
    noise: np.ndarray  # (n) of each row's signals

    def told(self, W: np.ndarray, rows: float) -> tuple[float, np.ndarray]:
        """Return the nats that ``rows`` rows tell, N of which are W (N, n, p), and d/dW of it."""
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
        """Return what ``rows`` rows tell, N of which are W (N, n, p)."""
        seen = (W / self.noise[:, None]).reshape(W.shape[0] * W.shape[1], len(self.names))
        H, still = rows / max(len(W), 1) * (seen.T @ seen), np.zeros(len(self.names))
        return Information(
            self.names, self.initial, H, still, self.noise, round(rows * len(self.noise))
        )


class Aim:
    """The unknown parameters of a robot, seen in its torques and in positions of its frame.

    Attributes:
        dynamic, kinematic: how many combinations of the parameters any motion tells apart.
    """

    def __init__(self, robot: Robot, dynamics: Dynamics, kinematics: TaskKinematics) -> None:
        """Take the believed robot and its models; parameters that no motion shows are left out.

        Raises:
            ParameterError: nothing is unknown, or no motion shows any of it.
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
        self._place = _place_part(robot, kinematics)
        self.dynamic, self.kinematic = len(self._torque.chosen), len(self._place.chosen)
        if not self.dynamic + self.kinematic:
            names = ", ".join((*dynamics.names, *kinematics.names)[:10])
            raise ParameterError(
                f"no motion of '{robot.name}' from its base to '{robot.frame}' shows any of the "
                f"unknown parameters ({names}).",
                where="unknown",
                hint="Name bodies further out; pinadapt.base_parameters tells which combinations "
                "show.",
            )

    def told(self, q: np.ndarray, v: np.ndarray, a: np.ndarray, duration: float) -> float:
        """Return the nats that N states (N, .), spread over a duration [s], tell."""
        rows = duration / BLOCK
        torque, _ = self._torque.told(self._torques(q, v, a), rows)
        place, _ = self._place.told(self._places(q), rows)
        return torque + place

    def told_and_slopes(
        self, q: np.ndarray, v: np.ndarray, a: np.ndarray, duration: float, first: int
    ) -> tuple[float, np.ndarray]:
        """Return what the first states tell, and by how much others in their places tell more.

        To first order, one at a time: (k first) for k states in the place of each of the first, one
        block of them after the other.
        """
        rows, slopes = duration / BLOCK, np.zeros(len(q) - first)
        nats = 0.0
        for part, W in ((self._torque, self._torques(q, v, a)), (self._place, self._places(q))):
            if not W.size:
                continue
            told, slope = part.told(W[:first], rows)
            others = W[first:].reshape(-1, *W[:first].shape)
            slopes += np.einsum("tij,ktij->kt", slope, others - W[:first]).ravel()
            nats += told
        return nats, slopes

    def excitation(
        self, q: np.ndarray, v: np.ndarray, a: np.ndarray, duration: float
    ) -> Excitation:
        """Return what N states (N, .), spread over a duration [s], tell of each parameter."""
        rows, dynamics = duration / BLOCK, self._dynamics
        units: Mapping[str, str] = {name: "m" for name in self._kinematics.names} | dict(
            zip(dynamics.names, dynamics.units, strict=True)
        )
        return Excitation(
            self._torque.information(self._torques(q, v, a), rows),
            self._place.information(self._places(q), rows),
            units,
        )

    def _torques(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return the regressors Y (N, n, p) of the torques."""
        shape = len(q), self._robot.model.nv, self._dynamics.size
        if not self._dynamics.size:
            return np.zeros(shape)
        return np.array([self._dynamics.regressor(*z) for z in zip(q, v, a, strict=True)])

    def _places(self, q: np.ndarray) -> np.ndarray:
        """Return dx/da_k (N, m, p) of the positions."""
        kinematics = self._kinematics
        if not kinematics.size:
            return np.zeros((len(q), kinematics.positions, 0))
        kinematics.update(kinematics.initial, q[0], np.zeros(kinematics.nv))
        return np.array([kinematics.predicted(each)[1] for each in q])


def _torque_part(robot: Robot, dynamics: Dynamics) -> _Part:
    """Return the dynamic parameters: inertias off by 30 %, coefficients by a typical one."""
    base, (typical, Y) = base_parameters(dynamics, robot), _typical(robot, dynamics)
    efforts = effort_limits(robot.model)
    noise = _NOISE * np.where(np.isfinite(efforts), efforts, np.maximum(typical, typical.max()))
    sizes = np.sqrt(np.mean(Y**2, axis=(0, 1)))
    shown = np.sqrt(np.mean(typical**2)) / np.where(sizes > 0.0, sizes, np.inf)
    prior = _dynamic_prior(robot, dynamics)
    R = base.regrouping
    covariance = np.diag(shown[base.chosen] ** 2) if prior is None else R @ prior @ R.T
    return _Part(tuple(dynamics.names), dynamics.initial, base.chosen, _root(covariance), noise)


def _dynamic_prior(robot: Robot, dynamics: Dynamics) -> np.ndarray | None:
    """Return the covariance (p, p) of the dynamic parameters, or None where there is none."""
    size = dynamics.inertial.size
    inertial = prior_covariance(robot, dynamics) if size else np.zeros((0, 0))
    if inertial is None:
        return None
    covariance = np.diag(dynamics.typical**2)
    covariance[:size, :size] = inertial
    return covariance


def _place_part(robot: Robot, kinematics: TaskKinematics) -> _Part:
    """Return the kinematic parameters, each off by a tenth of the reach, as positions show them."""
    rng, m, size = np.random.default_rng(0), kinematics.positions, kinematics.size
    rows = [np.zeros((0, size))]
    for _ in range(_SAMPLES if size else 0):
        q = pin.integrate(robot.model, robot.q0, rng.uniform(-np.pi, np.pi, robot.model.nv))
        kinematics.update(kinematics.initial, q, np.zeros(robot.model.nv))
        rows.append(kinematics.prediction()[1])
    chosen, R = independent_columns(np.vstack(rows))
    root = _AWAY * robot.reach * _root(R @ R.T)
    noise = np.full(m, _SEEN * robot.reach)
    return _Part(tuple(kinematics.names), kinematics.initial, chosen, root, noise)


def _typical(robot: Robot, dynamics: Dynamics) -> tuple[np.ndarray, np.ndarray]:
    """Return the size of the torques (n) at seeded states around home, and Y (N, n, p) there."""
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
