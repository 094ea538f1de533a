"""What is known of an arm that is not exactly as described, beside the load that it carries.

With bodies that differ from the described ones by d, E[d d^T] = P = L L^T, what a run tells of
differences that are not the arm's has the information (H^-1 + P)^-1, that is
H - H L (1 + L^T H L)^-1 L^T H. A run of the same arm without load makes P smaller: to
(P^-1 + H_0)^-1, around another mean (Gauss and Markov, with a prior).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from .._table import Sheet, Table
from ..controller.controller import Controller
from ..controller.state import ControllerState, Sample
from ..exceptions import ParameterError
from ..models.bodies import ALL, BodyDynamics
from ..models.dynamics import Dynamics, StackedDynamics
from ..models.pseudo_inertia import COEFFICIENTS, ten_parameters
from ..models.regressor import LABELS, PER_BODY
from ..robot.changes import Payload
from ..robot.robot import Robot
from ..tuning.defaults import INERTIA, prior_covariance
from .information import Information, information_of, known_to


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
        mean, covariance = dynamics.value(robot), prior_covariance(robot, dynamics)
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
    if not dynamics.per_body:
        raise ParameterError(
            "no bodies follow from these parameters, so no arm can be told from its load.",
            where="arm",
            hint='Adapt bodies: dynamic = "all" or "payload".',
        )
    bodies, joints = BodyDynamics(dynamics.bare(robot), ALL), dynamics.joints
    return bodies if joints is None else StackedDynamics(bodies, joints)


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


_ARM = 0.9999  # share explained below which the arm is not as described
_STEP = 1e-6  # relative, of numerical derivatives
_ENTRIES = ("Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")


@dataclass(frozen=True, eq=False, repr=False)
class PayloadEstimate:
    """A load on the last body, with what each number is known to; ``print`` shows a table.

    Axes and origin are those of the described task frame, as of ``Payload``. An uncertainty is one
    standard deviation, with what the data would still have the number move by; infinite where the
    motion does not tell it from the rest.

    Attributes:
        mass, mass_known_to: kg.
        com, com_known_to: (3) centre of mass [m].
        inertia, inertia_known_to: (6) Ixx Ixy Iyy Ixz Iyz Izz about the centre of mass [kg m^2].
        explained: share, from 0 to 1, of all that was learned of bodies that is explained by a load
            on the last one; the rest is estimates that still move, or says that the arm is not as
            described either, which the uncertainties then make too little of.
    """

    mass: float
    mass_known_to: float
    com: np.ndarray
    com_known_to: np.ndarray
    inertia: np.ndarray
    inertia_known_to: np.ndarray
    explained: float

    def payload(self) -> Payload:
        """Return the load, as ``Robot.changed`` and ``Controller.believe`` take it.

        Its inertia may be one that no distribution of mass has, which these refuse: then leave it
        out, ``Payload(estimate.mass, estimate.com)``.
        """
        return Payload(self.mass, self.com, self.inertia)

    def __repr__(self) -> str:
        """Return a table."""
        return str(self._sheet())

    def _repr_html_(self) -> str:
        return self._sheet().html()

    def _sheet(self) -> Sheet:
        rows = [
            ("mass", f"{self.mass:.4g}", known_to(self.mass_known_to), "kg"),
            *(
                (f"centre {axis}", f"{1e3 * c:.2f}", known_to(1e3 * d), "mm")
                for axis, c, d in zip("xyz", self.com, self.com_known_to, strict=True)
            ),
            *(
                (name, f"{value:.4g}", known_to(deviation), "kg m^2")
                for name, value, deviation in zip(
                    _ENTRIES, self.inertia, self.inertia_known_to, strict=True
                )
            ),
        ]
        note = f"A load on the last body explains {self.explained:.3%} of what was learned."
        if self.explained < _ARM:
            note += (
                " The rest is estimates that still move, or an arm that is not as described, of "
                "which the load may hold a part."
            )
        return Sheet("Load", [Table(rows, ("", "value", "known to", "unit"))], note)


def payload_estimate(
    controller: Controller, found: Information, prior: ArmPrior | None = None
) -> PayloadEstimate:
    """Return the load that explains best how what was learned differs from the arm as known.

    With D the learned bodies less the known ones and H the information of the run, it is the d
    with least (D - E d)^T H (D - E d), where E d changes the last body alone, and rotors and
    friction at will. Where nothing but the last body was unknown, d is D. What neither load nor arm
    explain is spread over the directions that a load does not have, and counts as much in those
    that it has.

    Args:
        controller: that learned.
        found: what the run tells of its estimate, or of one that was refined; of all bodies where
            there is a prior.
        prior: what is known of the arm; None: it is as described.

    Raises:
        ParameterError: the last body is not among the parameters.
    """
    robot, names = described(controller), list(found.names)
    last = [f"{robot.joint_names[-1]}.{label}" for label in LABELS]
    known = (
        controller.dynamics.value(robot) if set(last) <= set(controller.dynamics.names) else None
    )
    if known is None:
        raise ParameterError(
            "the last body is not among what was adapted, so no load was learned.",
            where="payload",
            hint='Adapt it: dynamic = "all" or "payload".',
        )
    joints = [i for i, name in enumerate(names) if name.rpartition(".")[2] not in LABELS]
    part = [*(names.index(name) for name in last), *joints]
    if prior is None:
        found = replace(found, estimate=found.estimate - known)
    else:
        found = prior.seen_through(found)
    difference = found.estimate
    load, left = _fitted(found, difference, part)
    _, unloaded = _fitted(found, difference, joints)
    transform = _into(robot)
    ten = transform @ load.estimate[:PER_BODY]
    gradient = np.zeros((PER_BODY, len(part)))
    gradient[:, :PER_BODY] = _gradient(_as_payload, ten) @ transform
    value, known = _as_payload(ten), load.deviation(gradient)
    return PayloadEstimate(
        float(value[0]),
        float(known[0]),
        value[1:4],
        known[1:4],
        value[4:],
        known[4:],
        1.0 - left / unloaded if unloaded > 0.0 else 1.0,
    )


def _fitted(
    found: Information, difference: np.ndarray, part: list[int]
) -> tuple[Information, float]:
    """Return a difference (p) put into some of the parameters alone, and the square of the rest."""
    names, H = tuple(found.names[i] for i in part), found.H[np.ix_(part, part)]
    rest = difference.copy()
    rest[part] = 0.0
    whole = Information(names, difference[part], H, (found.H @ rest)[part], found.noise, found.rows)
    fitted = whole.estimate + whole.correction
    rest[part] = difference[part] - fitted
    left = float(rest @ found.H @ rest)
    open_to_the_arm = found.rank - whole.rank
    noisier = max(left / max(open_to_the_arm, 1), 1.0)
    pull = (found.pull + found.H @ rest)[part]
    return Information(names, fitted, H / noisier, pull / noisier, found.noise, found.rows), left


def _into(robot: Robot) -> np.ndarray:
    """Return what turns ten parameters about the last joint into those of the task frame's axes."""
    G = robot.model.frames[robot.frame_id].placement.inverse().homogeneous
    return np.column_stack([ten_parameters(G @ F @ G.T) for F in COEFFICIENTS])


def _as_payload(ten: np.ndarray) -> np.ndarray:
    """Return mass, centre of mass and inertia about it (10) of ten parameters (10)."""
    mass = ten[0] if ten[0] else np.nan
    com = ten[1:4] / mass
    xx, xy, yy, xz, yz, zz = ten[4:]
    about = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) + mass * (
        pin.skew(com) @ pin.skew(com)
    )
    return np.array([mass, *com, *about[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]])


def _gradient(of: Callable[[np.ndarray], np.ndarray], at: np.ndarray) -> np.ndarray:
    """Return the Jacobian of a function at a point by central differences."""
    step = _STEP * max(float(np.abs(at).max()), 1e-3)
    return np.column_stack(
        [(of(at + step * unit) - of(at - step * unit)) / (2.0 * step) for unit in np.eye(len(at))]
    )
