"""The load that a run identified, with an arm that is as described or itself uncertain.

Let the bodies of the arm differ from the described ones by d with E[d d^T] = P = L L^T, and let H
be the information of a run about all bodies. Marginalised over d, the information about any other
change of the bodies, such as a load, is (H^-1 + P)^-1. A run of the same arm without load reduces P
to (P^-1 + H_0)^-1 around another mean, by Bayes' rule for normal distributions.

The same change of the bodies may have other explanations: all inertias scaled, or links that are
wrong. Each is a model in which the bodies differ from their description by D = G theta, theta
normal with mean zero and unit covariance, the coefficients of the joints free. With R the square
root of the information of a run, c = R D of the least-squares estimate, both less what the
coefficients explain, and M = R G, the evidence for it is normal too:

    log p = -(c^T (1 + M M^T)^-1 c + log det(1 + M M^T)) / 2.

The determinant penalises models that could explain many different changes. A load on an arm as
described has ten parameters and leaves all other combinations unchanged, which wrong links would
do only by coincidence. All inertias scaled by one number have the smallest penalty. The prior
probability of a load on the arm as described is 0.9. D. J. C. MacKay, *Bayesian interpolation*,
Neural Computation 4 (1992) 415-447.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio as pin

from .._output import Sheet, Table
from ..controller.controller import Controller
from ..controller.state import ControllerState, Sample
from ..exceptions import ParameterError
from ..models.bodies import ALL, COEFFICIENTS, UNCERTAINTY, BodyDynamics, ten_parameters
from ..models.dynamics import Dynamics, StackedDynamics
from ..models.physical_fit import PhysicalSet
from ..models.regressor import LABELS, PER_BODY
from ..robot.changes import Payload
from ..robot.robot import Robot
from ..tuning.defaults import INERTIA, prior_covariance
from .information import Information, dynamic_information, known_to

AS_DESCRIBED = "the arm as described"  # first words of the plain explanation
LEAST_NOISE = 1e-4  # of a torque, where explanations are compared: no model is better
_SCALE = 0.5  # standard deviation of a common factor of all inertias
_OFF = (0.003, 0.01, 0.03, 0.1, 0.3)  # shares by which bodies may be off, each by its own
_PLAIN = 0.9  # prior probability that the arm is as described
_SURE = 0.95  # probability from which on there is a load
_USUAL = 0.1  # of the robot's mass and reach: mass and radius of a load that is expected
_ENTRIES = ("Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")


@dataclass(frozen=True, eq=False)
class Explanation:
    """One explanation of the change of the bodies.

    Attributes:
        words: the explanation in words.
        probability: of it, relative to the others.
        explained: share, from 0 to 1, of the change that it accounts for.
        loaded: whether a load is part of it.
        load: (10) parameters of the load in the axes of the last joint; zero without one.
        covariance: (10, 10) of the load's parameters.
    """

    words: str
    probability: float
    explained: float
    loaded: bool
    load: np.ndarray
    covariance: np.ndarray

    @property
    def mass(self) -> float:
        """Mass of the load [kg]."""
        return float(self.load[0])


def explanations(found: Information, prior: ArmPrior, load: np.ndarray) -> tuple[Explanation, ...]:
    """Return the explanations of a change of the bodies, the most probable one first.

    Args:
        found: information about k bodies, ten parameters each, and then the joints' coefficients.
        prior: of bodies that are off by 30 %, each by its own.
        load: (10, 10) root of the covariance of a load, in the axes of the last joint.
    """
    free, p = prior.coefficients, len(found.names)
    R, c = found.marginalised(free=free).equations
    c = c + R @ (found.estimate - prior.mean)
    on_last = np.zeros((p, PER_BODY))
    on_last[free.start - PER_BODY : free.start] = load
    common = _SCALE * prior.mean[:, None]
    common[free] = 0.0
    others = (1.0 - _PLAIN) / 4.0
    cases = [(AS_DESCRIBED, common[:, :0], True, _PLAIN)]
    for loaded in (True, False):
        cases.append(("", common, loaded, others))
        for share in _OFF:
            root = share / UNCERTAINTY * prior.root
            words = f"each body off by some {100.0 * share:g} %"
            cases.append((words, root, loaded, others / len(_OFF)))
    made, evidence = [], []
    for words, root, loaded, before in cases:
        G = np.hstack([on_last, root]) if loaded else root
        U, s, Vt = np.linalg.svd(R @ G)
        g, shrunk, variances = U.T @ c, np.ones(p), np.ones(len(Vt))
        shrunk[: len(s)] = variances[: len(s)] = 1.0 / (1.0 + s**2)
        theta = Vt[: len(s)].T @ (s * shrunk[: len(s)] * g[: len(s)])
        covariance = (Vt.T * variances) @ Vt
        evidence.append(np.log(before) - 0.5 * float(shrunk @ g**2 - np.sum(np.log(shrunk))))
        whole = float(g @ g)
        explained = 1.0 - float(np.sum((shrunk * g) ** 2)) / whole if whole > 0.0 else 1.0
        if not words:
            factor = 1.0 + _SCALE * theta[-1]
            words = f"all inertias {factor:.2f} times the described ones"
        words += ", and a load" if loaded else ", and no load"
        own = load if loaded else np.zeros((PER_BODY, 0))
        k = own.shape[1]
        part = own @ theta[:k], own @ covariance[:k, :k] @ own.T
        made.append(Explanation(words, 0.0, explained, loaded, *part))
    odds = np.exp(np.array(evidence) - max(evidence))
    ordered = sorted(zip(odds / odds.sum(), made, strict=True), key=lambda each: -each[0])
    return tuple(replace(one, probability=float(share)) for share, one in ordered)


def sure(given: tuple[Explanation, ...]) -> bool:
    """Return whether some load is part of what explains the change; True without explanations."""
    return not given or sum(one.probability for one in given if one.loaded) >= _SURE


@dataclass(frozen=True, eq=False, repr=False)
class PayloadEstimate:
    """A load on the last body and its uncertainty; ``print`` shows a table.

    Axes and origin are those of the described task frame, as of ``Payload``. An uncertainty is one
    standard deviation, combined with the step from the estimate to the least-squares one. It is
    infinite where the motion does not identify the number.

    Attributes:
        mass, mass_known_to: mass and its uncertainty [kg].
        com, com_known_to: (3) centre of mass [m].
        inertia, inertia_known_to: (6) Ixx Ixy Iyy Ixz Iyz Izz about the centre of mass [kg m^2].
        explained: share, from 0 to 1, of the change of all bodies that a load on the last body
            accounts for. If it is not nearly one, estimates still move, or the arm is not as
            described; in the latter case the uncertainties are too small, unless other explanations
            are compared.
        explanations: what else explains the change of the bodies, the most probable first, see
            ``explanations``; their loads are part of the uncertainties. Empty where an uncertainty
            of the arm was stated, or its bodies are unknown.
    """

    mass: float
    mass_known_to: float
    com: np.ndarray
    com_known_to: np.ndarray
    inertia: np.ndarray
    inertia_known_to: np.ndarray
    explained: float = 1.0
    explanations: tuple[Explanation, ...] = ()

    @classmethod
    def of(cls, value: np.ndarray, deviation: np.ndarray, *rest: Any) -> PayloadEstimate:
        """Take mass, centre of mass and inertia (10), and their uncertainties (10)."""
        parts = [(float(each[0]), each[1:4], each[4:]) for each in (value, deviation)]
        return cls(*(one for both in zip(*parts, strict=True) for one in both), *rest)

    @property
    def certain(self) -> bool:
        """Whether some load explains the data with a probability of at least 95 %."""
        return sure(self.explanations)

    def payload(self) -> Payload:
        """Return the load, as ``Robot.changed`` and ``Controller.announce`` take it.

        These refuse an inertia that no distribution of mass has, which an estimate may be. Then
        leave the inertia out: ``Payload(estimate.mass, estimate.com)``.
        """
        return Payload(self.mass, self.com, self.inertia)

    def __repr__(self) -> str:
        """Return a table."""
        return str(self._sheet())

    def _repr_html_(self) -> str:
        return self._sheet().html()

    def _sheet(self) -> Sheet:
        note = f"A load on the last body accounts for {self.explained:.3%} of the change."
        if not self.certain:
            note += " It is not certain that there is a load."
        return Sheet("Load", self.tables(), note)

    def tables(self) -> list[Table]:
        """Return the load with its uncertainty, and what else explains the data."""
        names = ("mass", "centre x", "centre y", "centre z", *_ENTRIES)
        values = [self.mass, *self.com, *self.inertia]
        known = [self.mass_known_to, *self.com_known_to, *self.inertia_known_to]
        units = ["kg", *["m"] * 3, *["kg m^2"] * 6]
        rows = [
            (name, f"{value:.4g}", known_to(deviation), unit)
            for name, value, deviation, unit in zip(names, values, known, units, strict=True)
        ]
        others = [
            (one.words, f"{one.explained:.3%}", f"{one.probability:.3f}", f"{one.mass:.4g} kg")
            for one in self.explanations[:5]
        ]
        header = ("explanation of the data", "explains", "probability", "load")
        tables = [Table(rows, ("load", "value", "known to", "unit"))]
        return [*tables, *([Table(others, header)] if others else [])]


def payload_estimate(
    controller: Controller,
    found: Information,
    prior: ArmPrior | None = None,
    others: tuple[Explanation, ...] = (),
) -> PayloadEstimate:
    """Return the load that best explains the change of the bodies, estimated less known.

    Let D be that change and H its information. The load is the d that minimises
    (D - E d)^T H (D - E d), where E d changes the last body and the coefficients of the joints.
    If only the last body was unknown, d = D. What neither load nor arm explain is taken for noise
    and increases the uncertainty. To the variance come, by the probability of each explanation but
    that of a load on the arm as described, its own variance and the square of its distance.

    Args:
        controller: that adapted.
        found: information of the run at an estimate; of all bodies if there is a prior.
        prior: of the arm; None: the arm is as described.
        others: explanations of the same data, which widen the uncertainties.

    Raises:
        ParameterError: the last body is not among the parameters.
    """
    robot, names = described_robot(controller), list(found.names)
    last = [f"{robot.joint_names[-1]}.{label}" for label in LABELS]
    known = (
        controller.dynamics.value(robot) if set(last) <= set(controller.dynamics.names) else None
    )
    if known is None:
        raise ParameterError(
            "the last body was not adapted, so there is no estimate of a load.",
            where="payload",
            hint='Adapt it: dynamic = "all" or "payload".',
        )
    joints = [i for i, name in enumerate(names) if name.rpartition(".")[2] not in LABELS]
    part = [*(names.index(name) for name in last), *joints]
    change = replace(found, estimate=found.estimate - (known if prior is None else prior.mean))
    if prior is not None:
        change = change.marginalised(prior.root)
    load, rest = _restricted(change, part)
    _, rest_without_load = _restricted(change, joints)
    value, gradient = _of_load(robot, load.estimate[:PER_BODY])
    deviation = load.deviation(np.hstack([gradient, np.zeros((PER_BODY, len(joints)))]))
    for one in others:
        if not one.words.startswith(AS_DESCRIBED):
            apart = gradient @ (one.load - load.estimate[:PER_BODY])
            own = np.maximum(np.einsum("mi,ij,mj->m", gradient, one.covariance, gradient), 0.0)
            deviation = np.sqrt(deviation**2 + one.probability * (apart**2 + own))
    if not sure(others):
        deviation[1:] = np.inf  # of what is perhaps not there
    share = 1.0 - rest / rest_without_load if rest_without_load > 0.0 else 1.0
    return PayloadEstimate.of(value, deviation, share, others)


def _restricted(change: Information, part: list[int]) -> tuple[Information, float]:
    """Return a change (p) explained by some parameters alone, and the squared rest of the fit."""
    names, H = tuple(change.names[i] for i in part), change.H[np.ix_(part, part)]
    rest = change.estimate.copy()
    rest[part] = 0.0
    score = (change.H @ rest)[part]
    start = Information(names, change.estimate[part], H, score, change.noise, change.rows)
    fitted = start.estimate + start.correction
    rest[part] = change.estimate[part] - fitted
    squared = float(rest @ change.H @ rest)
    variance = max(squared / max(change.rank - start.rank, 1), 1.0)  # in parts of the noise's
    score = (change.score + change.H @ rest)[part]
    return replace(start, estimate=fitted, H=H / variance, score=score / variance), squared


def explanations_of(
    controller: Controller, dynamics: Dynamics, found: Information
) -> tuple[Explanation, ...]:
    """Return what explains the change of an arm's bodies; none where the description is lacking.

    A load is expected to have about a tenth of the robot's mass, within a tenth of its reach from
    the task frame.

    Args:
        controller: that adapted.
        dynamics: of all bodies, see ``whole_arm``.
        found: information about all of them.
    """
    robot = described_robot(controller)
    try:
        arm = ArmPrior.of(robot, dynamics, INERTIA)
    except ParameterError:
        return ()
    expected = _USUAL * robot.mass * np.diag([*[(_USUAL * robot.reach) ** 2] * 3, 1.0])
    ten = ten_parameters(expected)
    root = PhysicalSet(1, ten).local(ten)[0]
    return explanations(found, arm, np.linalg.solve(_to_task_frame(robot), root))


def payload_of(found: Information, part: slice, robot: Robot) -> PayloadEstimate:
    """Return the load whose ten parameters, at the last joint, are a part of an estimate.

    Args:
        found: the estimate with its information.
        part: where the ten parameters are.
        robot: with the task frame.
    """
    gradient = np.zeros((PER_BODY, len(found.names)))
    value, gradient[:, part] = _of_load(robot, found.estimate[part])
    return PayloadEstimate.of(value, found.deviation(gradient))


def _to_task_frame(robot: Robot) -> np.ndarray:
    """Return the matrix (10, 10) that takes ten parameters of the last joint to the task frame."""
    G = robot.model.frames[robot.frame_id].placement.inverse().homogeneous
    return np.column_stack([ten_parameters(G @ F @ G.T) for F in COEFFICIENTS])


def _of_load(robot: Robot, ten: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return mass, centre and inertia about it (10) of ten parameters at the last joint.

    The second is the derivative (10, 10) by these parameters.
    """
    to_frame = _to_task_frame(robot)
    mass, *rest = to_frame @ ten
    mass, entries = mass or np.nan, ([0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2])
    com = np.array(rest[:3]) / mass
    S, slope = pin.skew(com), np.eye(PER_BODY)
    slope[1:4, 0], slope[1:4, 1:4] = -com / mass, np.eye(3) / mass
    slope[4:, 0] = -(S @ S)[entries]
    for k, axis in enumerate(map(pin.skew, np.eye(3)), 1):
        slope[4:, k] = (axis @ S + S @ axis)[entries]
    return np.array([mass, *com, *(rest[3:] + mass * (S @ S)[entries])]), slope @ to_frame


@dataclass(frozen=True, eq=False)
class ArmPrior:
    """What is known of all bodies of an arm before a load; the joints' coefficients are free.

    Attributes:
        mean: (p) of bodies, and of joints as described.
        root: (p, k) L of the covariance L L^T of the bodies, zero for the joints.
        coefficients: where the joints' coefficients are.
    """

    mean: np.ndarray
    root: np.ndarray
    coefficients: slice

    @classmethod
    def of(cls, robot: Robot, dynamics: Dynamics, share: float) -> ArmPrior:
        """Return a prior around the description, whose standard deviation is a share of it.

        Raises:
            ParameterError: the description has bodies without inertia.
        """
        mean, covariance = dynamics.value(robot), prior_covariance(robot, dynamics)
        if covariance is None or mean is None:
            raise ParameterError(
                "the description has bodies without inertia, of which an uncertainty cannot be "
                "stated as a share.",
                where="arm",
                hint="State the robot's mass when it is loaded, or leave arm out.",
            )
        values, vectors = np.linalg.eigh(covariance)
        root = np.zeros((dynamics.size, len(values)))
        root[: len(values)] = share / INERTIA * vectors * np.sqrt(np.maximum(values, 0.0))
        return cls(mean, root, slice(len(values), dynamics.size))

    def after(self, found: Information) -> ArmPrior:
        """Return the posterior after a run without load, whatever the joints' coefficients are."""
        R, c = found.marginalised(free=self.coefficients).equations
        c = c + R @ (found.estimate - self.mean)
        _, s, Vt = np.linalg.svd(R @ self.root)
        root = self.root @ Vt.T
        root[:, : len(s)] /= np.sqrt(1.0 + s**2)
        return replace(self, mean=self.mean + root @ (root.T @ (R.T @ c)), root=root)


def whole_arm(controller: Controller) -> Dynamics:
    """Return the dynamics of all bodies, with the joints' coefficients that a controller adapts.

    Raises:
        ParameterError: its parameters are lumped, or in a basis of the user's own.
    """
    dynamics, robot = controller.dynamics, described_robot(controller)
    if not dynamics.per_body:
        raise ParameterError(
            "these parameters are not those of bodies, so load and arm cannot be separated.",
            where="arm",
            hint='Adapt bodies: dynamic = "all" or "payload".',
        )
    bodies, joints = BodyDynamics(dynamics.bare(robot), ALL), dynamics.joints
    return bodies if joints is None else StackedDynamics(bodies, joints)


def whole_arm_information(
    controller: Controller,
    dynamics: Dynamics,
    samples: Sequence[Sample],
    state: ControllerState,
    **options: float,
) -> Information:
    """Return the information of a run on all bodies; those not adapted are as described.

    Args:
        controller: that ran.
        dynamics: of all bodies, see ``whole_arm``.
        samples: of the run.
        state: whose estimates are taken.
        options: of ``dynamic_information``.
    """
    robot = described_robot(controller)
    adapted = dict(zip(controller.dynamics.names, state.a_d, strict=True))
    value = dynamics.value(robot)
    described = dynamics.initial if value is None else value
    a = [adapted.get(name, each) for name, each in zip(dynamics.names, described, strict=True)]
    return dynamic_information(dynamics, robot.model, samples, np.array(a), **options)


def described_robot(controller: Controller) -> Robot:
    """Return the robot as described, without a load that was announced to the controller."""
    nominal = controller.nominal
    return controller.kinematics.robot if nominal is None else nominal.unloaded
