"""The load that a run identified, with an arm that is as described or itself uncertain.

Let the bodies of the arm differ from the described ones by d with E[d d^T] = P = L L^T, and let H
be the information of a run about all bodies. Marginalised over d, the information about any other
change of the bodies, such as a load, is (H^-1 + P)^-1. A run of the same arm without load reduces P
to (P^-1 + H_0)^-1 around another mean, by Bayes' rule for normal distributions.

Without a stated P, each body is off by the same share of its inertia, and the share is the one of
largest evidence beside a load of usual size (D. J. C. MacKay, *Bayesian interpolation*, Neural
Computation 4, 1992, 415-447). With R the square root of H, c = R D of the least-squares change D,
both less what the coefficients of the joints explain, and M = R (load, L), it is

    log p = -(c^T (1 + M M^T)^-1 c + log det(1 + M M^T)) / 2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from .._output import Printed, Report, Table
from ..controller.controller import Controller
from ..controller.state import ControllerState, Sample
from ..exceptions import ParameterError
from ..models.bodies import ALL, BodyDynamics, nearest_physical
from ..models.dynamics import Dynamics, StackedDynamics
from ..models.physical_fit import PhysicalSet
from ..models.regressor import LABELS, PER_BODY
from ..robot.changes import Payload
from ..robot.robot import LOAD, Robot
from ..tuning.defaults import INERTIA, prior_covariance
from .information import Information, dynamic_information, estimate_table

# of a torque, of which no model of an arm explains more; half, twice: deviations 1 % less, more
LEAST_NOISE = 1e-4


class PayloadEstimate(Printed):
    """A load on the body of the task frame and its uncertainty; ``print`` shows a table.

    Axes and origin are those of the described task frame, as of ``Payload``. An uncertainty is one
    standard deviation, combined with the step from the estimate to the least-squares one. It is
    infinite where the motion does not identify the number.

    Attributes:
        mass, mass_known_to: mass and its uncertainty [kg].
        com, com_known_to: (3) centre of mass [m].
        inertia, inertia_known_to: (6) Ixx Ixy Iyy Ixz Iyz Izz about the centre of mass [kg m^2].
        numbers: mass, centre of mass and inertia (10), and their uncertainties (10).
        explained: share, from 0 to 1, of the change of all bodies that the load accounts for.
            If it is not nearly one, estimates still move, or the arm is not as described.
    """

    def __init__(self, value: np.ndarray, deviation: np.ndarray, explained: float = 1.0) -> None:
        """Take mass, centre of mass and inertia (10), and their uncertainties (10)."""
        self.numbers = value, deviation
        self.mass = float(value[0])
        self.mass_known_to = float(deviation[0])
        self.com = value[1:4]
        self.com_known_to = deviation[1:4]
        self.inertia = value[4:]
        self.inertia_known_to = deviation[4:]
        self.explained = explained

    def payload(self) -> Payload:
        """Return the load, as ``Robot.changed`` and ``Controller.announce`` take it.

        An inertia that no distribution of mass has is replaced by a physical one close to it.

        Raises:
            RobotError: a negative mass.
        """
        pi = nearest_physical(np.array([self.mass, 0.0, 0.0, 0.0, *self.inertia]))
        return Payload(self.mass, self.com, pi[4:])

    def report(self) -> Report:
        """Return the table, and what the load accounts for where other bodies changed too."""
        note = f"A load accounts for {self.explained:.3%} of the change."
        return Report("Load", [self.table()], note if self.explained < 1.0 else "")

    def table(self) -> Table:
        """Return the load with its uncertainty."""
        return estimate_table(
            ("mass", "centre x", "centre y", "centre z", *LABELS[4:]),
            *self.numbers,
            ["kg", *["m"] * 3, *["kg m^2"] * 6],
            "load",
        )


def payload_estimate(
    controller: Controller, found: Information, prior: ArmPrior
) -> PayloadEstimate:
    """Return the load that best explains the change of the bodies, estimated less known.

    Let D be that change and H its information whatever the coefficients of the joints are. The
    load is the d that minimises (D - E d)^T H (D - E d), where E d changes the body of the task
    frame. If only that was unknown, d = D. What neither load nor arm explain is taken for noise and
    increases the uncertainty.

    Args:
        controller: that adapted.
        found: information of the run at an estimate, of the bodies of the prior.
        prior: of the arm.

    Raises:
        ParameterError, RobotError: as ``loaded_part``.
    """
    robot = described_robot(controller)
    loaded_part(controller.dynamics.names, robot)
    change = prior.change(found).marginalised(prior.root)
    whole = change.R @ change.estimate
    own = loaded_part(change.names, robot)
    R = change.R[:, own]
    D = change.estimate[own]
    load = Information(change.names[own], D, R, whole - R @ D).refined()
    left = whole - R @ load.estimate
    squared = left @ left
    squared_without_load = whole @ whole
    noise = np.sqrt(max(squared / max(change.rank - load.rank, 1), 1.0))  # in parts of that
    load = replace(load, R=R / noise, c=(change.c + left) / noise)
    value, gradient = of_load(robot, load.estimate)
    share = 1.0 - squared / squared_without_load if squared_without_load > 0.0 else 1.0
    return PayloadEstimate(value, load.deviation(gradient), share)


def payload_of_uncertain_arm(
    controller: Controller, dynamics: Dynamics, found: Information
) -> PayloadEstimate:
    """Return the load on the arm as described; its uncertainty covers an arm that is not.

    That is the uncertainty with the likeliest prior of the arm, combined with the distance between
    the estimates with and without it.

    Args:
        controller: that adapted.
        dynamics: of all bodies, see ``whole_arm``.
        found: information of the run about all of them.

    Raises:
        ParameterError: as ``payload_estimate``.
    """
    robot = described_robot(controller)
    plain = payload_estimate(controller, found, ArmPrior.of(robot, dynamics, 0.0))
    likeliest = ArmPrior.likeliest(robot, dynamics, found)
    value, known = payload_estimate(controller, found, likeliest).numbers
    own, _ = plain.numbers
    return PayloadEstimate(own, np.hypot(known, value - own), plain.explained)


def loaded_part(names: tuple[str, ...], robot: Robot) -> slice:
    """Return where among parameters are the ten of the body of the task frame, which has the load.

    Raises:
        ParameterError: they are not among them.
        RobotError: there are several task frames.
    """
    robot.check_single_frame()
    joint = robot.joint_names[robot.carriers[0]]
    mass = f"{joint}.{LABELS[0]}"
    if mass not in names:
        raise ParameterError(
            f"the body that {joint} moves was not adapted, so there is no estimate of a load on "
            f"'{robot.frame}'.",
            where="payload",
            hint='Adapt it: unknown="bodies" or "payload".',
        )
    first = names.index(mass)
    return slice(first, first + PER_BODY)


def of_load(robot: Robot, pi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return mass, centre and inertia about it (10) of ten parameters at the frame's joint.

    Centre and inertia are in the task frame. The second is the derivative (10, 10) by these
    parameters, by differences.
    """
    frame = robot.model.frames[robot.frame_id].placement

    # of the largest parameter; a hundredth and a hundred times as much: the same
    step = 1e-6 * (np.abs(pi).max() or 1.0)

    def load(pi: np.ndarray) -> np.ndarray:
        mass = pi[0] or step  # of nothing the centre is at the joint, or anywhere
        body = frame.actInv(pin.Inertia.FromDynamicParameters(np.append(mass, pi[1:])))
        return np.array([pi[0], *body.lever, *body.inertia[np.tril_indices(3)]])

    steps = step * np.eye(PER_BODY)
    slopes = [(load(pi + h) - load(pi - h)) / (2.0 * h.sum()) for h in steps]
    return load(pi), np.column_stack(slopes)


def usual_load(robot: Robot) -> np.ndarray:
    """Return the ten parameters, at the frame's joint, of a load as it may be: a ball at the frame.

    It has about a tenth of the robot's mass, within a tenth of its reach from the task frame.
    """
    ball = pin.Inertia.FromSphere(LOAD * robot.mass, LOAD * robot.reach)
    placement = robot.model.frames[robot.frame_id].placement
    return placement.act(ball).toDynamicParameters()


@dataclass(frozen=True, eq=False)
class ArmPrior:
    """What is known of all bodies of an arm before a load; nothing of the joints' coefficients.

    Attributes:
        mean: (p) of the bodies' parameters, after which the joints' coefficients come.
        root: (p, k) L of their covariance L L^T.
    """

    mean: np.ndarray
    root: np.ndarray

    @classmethod
    def of(cls, robot: Robot, dynamics: Dynamics, share: float) -> ArmPrior:
        """Return a prior around the description, whose standard deviation is a share of it.

        Raises:
            ParameterError: the description has bodies without inertia.
        """
        size = dynamics.inertial.size
        mean = described_values(dynamics, robot)[:size]
        root = np.zeros((size, size + 1))
        if share:
            covariance = prior_covariance(robot, dynamics)
            if covariance is None:
                raise ParameterError(
                    "the description has bodies without inertia, of which an uncertainty cannot "
                    "be stated as a share.",
                    where="arm",
                    hint="State the robot's mass when it is loaded, or leave arm out.",
                )
            root[:, :size] = share / INERTIA * np.linalg.cholesky(covariance)
            root[:, size] = share * mean  # all together, such as a wrong total mass
        return cls(mean, root)

    @classmethod
    def likeliest(cls, robot: Robot, dynamics: Dynamics, found: Information) -> ArmPrior:
        """Return the prior whose share has the largest evidence in a run with an unknown load.

        A load is expected to be like ``usual_load``. The share is zero where the description has
        bodies without inertia.

        Args:
            robot: as described.
            dynamics: of all bodies, see ``whole_arm``.
            found: information of the run about all of them.
        """
        try:
            plain = cls.of(robot, dynamics, 1.0)
        except ParameterError:
            return cls.of(robot, dynamics, 0.0)
        pi = usual_load(robot)
        change = plain.change(found)
        c = change.c + change.R @ change.estimate
        load = change.R[:, loaded_part(change.names, robot)] @ PhysicalSet(1, pi).local(pi)[0]
        arm = change.R @ plain.root

        def deviance(share: float) -> float:
            """Return -2 log of the evidence of a share, but for a constant."""
            U, s, _ = np.linalg.svd(np.hstack([load, share * arm]), full_matrices=False)
            return np.sum(np.log1p(s**2)) - s**2 / (1.0 + s**2) @ (U.T @ c) ** 2

        from scipy.optimize import minimize_scalar  # here, because scipy is slow to import

        share = minimize_scalar(deviance, bounds=(0.0, INERTIA), method="bounded").x
        return replace(plain, root=share * plain.root)

    def change(self, found: Information) -> Information:
        """Return the information on the bodies less their mean, whatever the coefficients are."""
        bodies = found.marginal(len(self.mean))
        return replace(bodies, estimate=bodies.estimate - self.mean)

    def after(self, found: Information) -> ArmPrior:
        """Return the posterior after a run without load, whatever the joints' coefficients are."""
        change = self.change(found)
        c = change.c + change.R @ change.estimate
        _, s, Vt = np.linalg.svd(change.R @ self.root)
        root = self.root @ Vt.T
        root[:, : len(s)] /= np.sqrt(1.0 + s**2)
        return replace(self, mean=self.mean + root @ (root.T @ (change.R.T @ c)), root=root)


def whole_arm(controller: Controller) -> Dynamics:
    """Return the dynamics of all bodies, with the joints' coefficients that a controller adapts.

    Raises:
        ParameterError: its parameters are lumped, or in a basis of the user's own.
    """
    dynamics = controller.dynamics
    if not dynamics.per_body:
        raise ParameterError(
            "these parameters are not those of bodies, so load and arm cannot be separated.",
            where="arm",
            hint='Adapt bodies: unknown="bodies" or "payload".',
        )
    bodies = BodyDynamics(dynamics.bare(described_robot(controller)), ALL)
    return bodies if dynamics.joints is None else StackedDynamics(bodies, dynamics.joints)


def whole_arm_information(
    controller: Controller,
    dynamics: Dynamics,
    samples: Sequence[Sample],
    state: ControllerState,
) -> Information:
    """Return the information of a run on all bodies; those not adapted are as described.

    Args:
        controller: that ran.
        dynamics: of all bodies, see ``whole_arm``.
        samples: of the run.
        state: whose estimates are taken.
    """
    robot = described_robot(controller)
    values = dict(zip(dynamics.names, described_values(dynamics, robot), strict=True))
    values |= zip(controller.dynamics.names, state.a_d, strict=True)
    a = np.array([values[name] for name in dynamics.names])
    return dynamic_information(dynamics, controller.kinematics, samples, a, LEAST_NOISE)


def described_values(dynamics: Dynamics, robot: Robot) -> np.ndarray:
    """Return the parameters (p) of a robot, the initial ones where it has none."""
    value = dynamics.value(robot)
    return dynamics.initial if value is None else value


def described_robot(controller: Controller) -> Robot:
    """Return the robot as described, without a load that was announced to the controller."""
    return controller.nominal.unloaded
