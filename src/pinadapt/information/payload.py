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

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

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
SCALE = 0.5  # standard deviation of a common factor of all inertias
OFF = (0.003, 0.01, 0.03, 0.1, 0.3)  # shares by which bodies may be off, each by its own
_PLAIN = 0.9  # prior probability that the arm is as described
_SURE = 0.95  # probability from which on there is a load


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


@dataclass(frozen=True, eq=False)
class _Fit:
    """A fitted explanation: log evidence, share explained, theta (k) and its covariance."""

    evidence: float
    explained: float
    theta: np.ndarray
    covariance: np.ndarray


def explanations(
    found: Information, known: np.ndarray, arm: np.ndarray, load: np.ndarray
) -> tuple[Explanation, ...]:
    """Return the explanations of a change of the bodies, the most probable one first.

    Args:
        found: information about k bodies, ten parameters each, and then the joints' coefficients.
        known: (p) the parameters of the description.
        arm: (p, l) L of the covariance L L^T of bodies that are off by 30 %, each by its own.
        load: (10, 10) root of the covariance of a load, in the axes of the last joint.
    """
    R, c = found.equations
    c = c + R @ (found.estimate - known)
    inertial = np.flatnonzero(arm.any(axis=1)).max(initial=-1) + 1
    Q, s, _ = np.linalg.svd(R[:, inertial:], full_matrices=False)
    Q = Q[:, s > np.finfo(float).eps * max(R.shape) * s.max(initial=0.0)]
    R, c = R - Q @ (Q.T @ R), c - Q @ (Q.T @ c)
    on_last, common = np.zeros((known.size, PER_BODY)), np.zeros((known.size, 1))
    on_last[inertial - PER_BODY : inertial] = load
    common[:inertial, 0] = SCALE * known[:inertial]
    none = np.zeros((known.size, 0))
    parts = [("arm", [none]), ("scale", [common])]
    parts.append(("off", [share / UNCERTAINTY * arm for share in OFF]))
    fits: list[tuple[str, bool, int, _Fit, float]] = []
    for name, roots in parts:
        for loaded in (True, False):
            if name == "arm" and not loaded:
                continue
            some = [_fit(R, c, np.hstack([on_last if loaded else none, root])) for root in roots]
            best = int(np.argmax([fit.evidence for fit in some]))
            mean = np.logaddexp.reduce([fit.evidence for fit in some]) - np.log(len(some))
            fits.append((name, loaded, best, some[best], float(mean)))
    odds = [np.log(_PLAIN if name == "arm" else (1.0 - _PLAIN) / 4.0) for name, *_ in fits]
    fits = [(*fit[:4], fit[4] + before) for fit, before in zip(fits, odds, strict=True)]
    total = np.logaddexp.reduce([evidence for *_, evidence in fits])
    made = [
        _explanation(name, loaded, best, fit, float(np.exp(evidence - total)), load)
        for name, loaded, best, fit, evidence in fits
    ]
    return tuple(sorted(made, key=lambda one: -one.probability))


def _fit(R: np.ndarray, c: np.ndarray, G: np.ndarray) -> _Fit:
    """Return the fit of c = R G theta + noise, both of unit covariance."""
    U, s, Vt = np.linalg.svd(R @ G, full_matrices=True)
    k = len(s)
    g, shrunk = U.T @ c, np.ones(len(c))
    shrunk[:k] = 1.0 / (1.0 + s**2)
    evidence = -0.5 * float(shrunk @ g**2 - np.sum(np.log(shrunk)))
    theta = Vt[:k].T @ (s * shrunk[:k] * g[:k])
    variances = np.ones(len(Vt))
    variances[:k] = shrunk[:k]
    rest, whole = float(np.sum((shrunk * g) ** 2)), float(g @ g)
    explained = 1.0 - rest / whole if whole > 0.0 else 1.0
    return _Fit(evidence, explained, theta, (Vt.T * variances) @ Vt)


def _explanation(
    name: str, loaded: bool, best: int, fit: _Fit, probability: float, root: np.ndarray
) -> Explanation:
    """Return an explanation in words, with its load."""
    load, covariance = np.zeros(PER_BODY), np.zeros((PER_BODY, PER_BODY))
    if loaded:
        load = root @ fit.theta[:PER_BODY]
        covariance = root @ fit.covariance[:PER_BODY, :PER_BODY] @ root.T
    factor = 1.0 + SCALE * float(fit.theta[-1])
    arm = {
        "arm": AS_DESCRIBED,
        "scale": f"all inertias {factor:.2f} times the described ones",
        "off": f"each body off by some {100.0 * OFF[best]:g} %",
    }[name]
    words = f"{arm}, and a load" if loaded else f"{arm}, and no load"
    return Explanation(words, probability, fit.explained, loaded, load, covariance)


def widened(
    load: np.ndarray, deviation: np.ndarray, gradient: np.ndarray, given: tuple[Explanation, ...]
) -> np.ndarray:
    """Return standard deviations (m) that cover the other explanations of a load.

    To the variance come, by the probability of each explanation but that of a load on the arm as
    described, its own variance and the square of its distance.

    Args:
        load: (10) parameters of the load on the arm as described.
        deviation: (m) of numbers of that load.
        gradient: (m, 10) of these numbers by the load's parameters.
        given: the explanations.
    """
    total = deviation**2
    for one in given:
        if not one.words.startswith(AS_DESCRIBED):
            apart = gradient @ (one.load - load)
            own = np.einsum("mi,ij,mj->m", gradient, one.covariance, gradient)
            total = total + one.probability * (apart**2 + np.maximum(own, 0.0))
    return np.asarray(np.sqrt(total))


def sure(given: tuple[Explanation, ...]) -> bool:
    """Return whether some load is part of what explains the change; True without explanations."""
    return not given or sum(one.probability for one in given if one.loaded) >= _SURE


_AS_DESCRIBED = 0.9999  # share explained by the load from which on the arm is as described
_OF_MASS, _OF_REACH = 0.1, 0.1  # of the robot: mass and radius of a load that is expected
LEAST_NOISE = 1e-4  # of a torque, where explanations are compared: no model is better
_STEP = 1e-6  # relative, of numerical derivatives
_ENTRIES = ("Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")


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
            accounts for. Below 0.9999 estimates still move, or the arm is not as described; in the
            latter case the uncertainties are too small, unless other explanations are compared.
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
    explained: float
    explanations: tuple[Explanation, ...] = ()

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
        return Sheet("Load", self.tables(), self.words())

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
            for one in self.explanations
        ]
        header = ("explanation of the data", "explains", "probability", "load")
        tables = [Table(rows, ("load", "value", "known to", "unit"))]
        return [*tables, *([Table(others, header)] if others else [])]

    def words(self) -> str:
        """Return in words how much a load explains, and what explains the data better."""
        note = f"A load on the last body accounts for {self.explained:.3%} of the change."
        if self.explanations:
            best = self.explanations[0]
            if not self.certain:
                note += " It is not certain that there is a load."
            if not best.words.startswith(AS_DESCRIBED):
                note += f" More probable: {best.words}"
                note += f" of {best.mass:.3g} kg." if best.loaded else "."
        elif self.explained < _AS_DESCRIBED:
            note += (
                " The rest is estimates that still move, or links that are not as described, which "
                "may also be part of the load found."
            )
        return note


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
    and increases the uncertainty.

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
    if prior is None:
        change = replace(found, estimate=found.estimate - known)
    else:
        change = prior.marginalised(found)
    load, rest = _restricted(change, part)
    _, rest_without_load = _restricted(change, joints)
    to_frame = _to_task_frame(robot)
    ten = to_frame @ load.estimate[:PER_BODY]
    gradient = np.zeros((PER_BODY, len(part)))
    gradient[:, :PER_BODY] = _derivative(_mass_com_inertia, ten) @ to_frame
    value, deviation = _mass_com_inertia(ten), load.deviation(gradient)
    deviation = widened(load.estimate[:PER_BODY], deviation, gradient[:, :PER_BODY], others)
    if not sure(others):
        deviation[1:] = np.inf  # of what is perhaps not there
    share = 1.0 - rest / rest_without_load if rest_without_load > 0.0 else 1.0
    return _estimate(value, deviation, share, others)


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
    expected = _OF_MASS * robot.mass * np.diag([*[(_OF_REACH * robot.reach) ** 2] * 3, 1.0])
    ten = ten_parameters(expected)
    root = PhysicalSet(1, ten).local(ten)[0]
    return explanations(found, arm.mean, arm.root, np.linalg.solve(_to_task_frame(robot), root))


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


def payload_of(found: Information, part: slice, robot: Robot) -> PayloadEstimate:
    """Return the load whose ten parameters, at the last joint, are a part of an estimate.

    Args:
        found: the estimate with its information.
        part: where the ten parameters are.
        robot: with the task frame.
    """
    to_frame = _to_task_frame(robot)
    ten = to_frame @ found.estimate[part]
    gradient = np.zeros((PER_BODY, len(found.names)))
    gradient[:, part] = _derivative(_mass_com_inertia, ten) @ to_frame
    return _estimate(_mass_com_inertia(ten), found.deviation(gradient))


def _estimate(
    value: np.ndarray,
    deviation: np.ndarray,
    share: float = 1.0,
    others: tuple[Explanation, ...] = (),
) -> PayloadEstimate:
    """Return the estimate of mass, centre of mass and inertia (10) with their deviations (10)."""
    return PayloadEstimate(
        float(value[0]),
        float(deviation[0]),
        value[1:4],
        deviation[1:4],
        value[4:],
        deviation[4:],
        share,
        others,
    )


def _to_task_frame(robot: Robot) -> np.ndarray:
    """Return the matrix (10, 10) that takes ten parameters of the last joint to the task frame."""
    G = robot.model.frames[robot.frame_id].placement.inverse().homogeneous
    return np.column_stack([ten_parameters(G @ F @ G.T) for F in COEFFICIENTS])


def _mass_com_inertia(ten: np.ndarray) -> np.ndarray:
    """Return mass, centre of mass and inertia about it (10) of ten parameters (10)."""
    mass = ten[0] if ten[0] else np.nan
    com = ten[1:4] / mass
    xx, xy, yy, xz, yz, zz = ten[4:]
    about = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) + mass * (
        pin.skew(com) @ pin.skew(com)
    )
    return np.array([mass, *com, *about[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]])


def _derivative(of: Callable[[np.ndarray], np.ndarray], at: np.ndarray) -> np.ndarray:
    """Return the Jacobian of a function at a point by central differences."""
    step = _STEP * max(float(np.abs(at).max()), 1e-3)
    return np.column_stack(
        [(of(at + step * unit) - of(at - step * unit)) / (2.0 * step) for unit in np.eye(len(at))]
    )


@dataclass(frozen=True, eq=False)
class ArmPrior:
    """What is known of all bodies of an arm before a load; the joints' coefficients are free.

    Attributes:
        mean: (p) of bodies, and of joints as described.
        root: (p, k) L of the covariance L L^T of the bodies, zero for the joints.
    """

    mean: np.ndarray
    root: np.ndarray

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
        return cls(mean, root)

    def after(self, found: Information) -> ArmPrior:
        """Return the posterior after a run without load, whatever the joints' coefficients are."""
        R, c = found.equations
        c = c + R @ (found.estimate - self.mean)
        free = ~self.root.any(axis=1)
        Q = _range(R[:, free])
        R, c = R - Q @ (Q.T @ R), c - Q @ (Q.T @ c)
        _, s, Vt = np.linalg.svd(R @ self.root)
        root = self.root @ Vt.T
        root[:, : len(s)] /= np.sqrt(1.0 + s**2)
        return ArmPrior(self.mean + root @ (root.T @ (R.T @ c)), root)

    def marginalised(self, found: Information) -> Information:
        """Return the information about a change from the mean that is not the arm's own.

        With H = R^T R and A = R L it is R^T (1 + A A^T)^-1 R, computed as a square of its own so
        that nothing cancels when the data are much better than the prior.
        """
        R, c = found.equations
        U, s, _ = np.linalg.svd(R @ self.root, full_matrices=False)
        less = (U * (1.0 - 1.0 / np.sqrt(1.0 + s**2))) @ U.T
        R, c = R - less @ R, c - less @ c
        return replace(found, estimate=found.estimate - self.mean, H=R.T @ R, score=R.T @ c)


def _range(columns: np.ndarray) -> np.ndarray:
    """Return an orthonormal basis of the range of a matrix."""
    U, s, _ = np.linalg.svd(columns, full_matrices=False)
    tolerance = np.finfo(float).eps * max(columns.shape) * s.max(initial=0.0)
    return np.asarray(U[:, s > tolerance])


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
