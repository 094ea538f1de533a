"""What is known of an arm that is not exactly as described, beside the load that it carries.

With bodies that differ from the described ones by d, E[d d^T] = P = L L^T, what a run tells of
differences that are not the arm's has the information (H^-1 + P)^-1, that is
H - H L (1 + L^T H L)^-1 L^T H. A run of the same arm without load makes P smaller: to
(P^-1 + H_0)^-1, around another mean (Gauss and Markov, with a prior).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..controller.controller import Controller
from ..controller.state import ControllerState
from ..exceptions import ParameterError
from ..models.bodies import ALL, BodyDynamics
from ..models.dynamics import Dynamics
from ..models.joint_effects import without_joint_effects
from ..models.stacked import StackedDynamics
from ..robot.robot import Robot
from ..tuning.prior import INERTIA, prior_covariance
from .information import Information, information_of
from .sample import Sample


@dataclass(frozen=True, eq=False)
class ArmPrior:
    """All bodies of an arm, before its load is known; the joints' coefficients are left open.

    Attributes:
        mean: (p) bodies, and joints as described.
        root: (p, .) L of their covariance L L^T, zero for the joints.
    """

    mean: np.ndarray
    root: np.ndarray

    @classmethod
    def of(cls, robot: Robot, dynamics: Dynamics, off: float) -> ArmPrior:
        """Return bodies that are as described but for some standard deviation, a share ``off``.

        Raises:
            ParameterError: bodies without inertia, of which no share can be off.
        """
        inertial = dynamics.inertial if isinstance(dynamics, StackedDynamics) else dynamics
        mean = dynamics.value(robot)
        covariance = prior_covariance(without_joint_effects(robot), inertial)
        if covariance is None or mean is None:
            raise ParameterError(
                "the description has bodies without inertia, so none of them can be known to a "
                "share of it.",
                where="arm",
                hint="State the robot's mass when it is loaded, or leave arm out.",
            )
        values, vectors = np.linalg.eigh(covariance)
        root = np.zeros((dynamics.size, len(values)))
        root[: len(values)] = off / INERTIA * vectors * np.sqrt(np.maximum(values, 0.0))
        return cls(mean, root)

    def after(self, found: Information) -> ArmPrior:
        """Return what is known once a run without load has told what it could."""
        joints = ~self.root.any(axis=1)
        H, pull = found.H, found.pull + found.H @ (found.estimate - self.mean)
        across = np.linalg.lstsq(H[np.ix_(joints, joints)], H[joints], rcond=None)[0]
        H, pull = H - H[:, joints] @ across, pull - across.T @ pull[joints]
        L = self.root
        values, U = np.linalg.eigh(np.eye(L.shape[1]) + L.T @ H @ L)
        root = L @ (U / np.sqrt(values))
        return ArmPrior(self.mean + root @ (root.T @ pull), root)

    def seen_through(self, found: Information) -> Information:
        """Return what a run tells of differences from the mean that are not the arm's own."""
        H, L = found.H, self.root
        less = H @ L @ np.linalg.solve(np.eye(L.shape[1]) + L.T @ H @ L, L.T)
        difference = found.estimate - self.mean
        pull = found.pull - less @ found.pull
        return replace(found, estimate=difference, H=H - less @ H, pull=pull)


def whole_arm(controller: Controller) -> Dynamics:
    """Return the dynamics of all bodies, with the joints' coefficients that a controller adapts.

    Raises:
        ParameterError: its parameters are lumped, or a basis of the user's own.
    """
    dynamics, robot = controller.dynamics, described(controller)
    inertial = dynamics.inertial if isinstance(dynamics, StackedDynamics) else dynamics
    if not isinstance(inertial, BodyDynamics):
        raise ParameterError(
            "no bodies follow from these parameters, so no arm can be told from its load.",
            where="arm",
            hint='Adapt bodies: dynamic = "all" or "payload".',
        )
    if isinstance(dynamics, StackedDynamics):
        bodies = BodyDynamics(without_joint_effects(robot), ALL)
        return StackedDynamics(bodies, dynamics.joint)
    return BodyDynamics(robot, ALL)


def described(controller: Controller) -> Robot:
    """Return the robot as described, without the load that it is believed to carry."""
    belief = controller.belief
    return controller.kinematics.robot if belief is None else belief.unloaded


def told_of_all(
    controller: Controller, dynamics: Dynamics, samples: Sequence[Sample], state: ControllerState
) -> Information:
    """Return what a run tells of all bodies, those that it did not adapt being as described."""
    robot = described(controller)
    adapted = dict(zip(controller.dynamics.names, state.a_d, strict=True))
    a = [
        adapted.get(name, value)
        for name, value in zip(dynamics.names, _value(dynamics, robot), strict=True)
    ]
    return information_of(dynamics, robot.model, samples, np.array(a))


def _value(dynamics: Dynamics, robot: Robot) -> np.ndarray:
    value = dynamics.value(robot)
    return dynamics.initial if value is None else value
