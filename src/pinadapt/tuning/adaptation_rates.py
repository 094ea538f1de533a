"""Which adaptation moves which estimate, and how fast; see ``defaults`` for the rule."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from .._checks import positive
from ..adaptation.adaptation import Adaptation
from ..adaptation.box_projection import BoxProjection
from ..adaptation.exponentiated_gradient import ExponentiatedGradient
from ..adaptation.frozen import Frozen
from ..adaptation.gradient import Gradient
from ..adaptation.mass_matrix_projection import MassMatrixProjection
from ..adaptation.matrix_inequality import BodyInequality, MatrixInequality
from ..adaptation.natural import Natural
from ..adaptation.stacked import Stacked
from ..exceptions import InputError, ParameterError
from ..laws.gains import Gains
from ..models.bodies import BodyDynamics
from ..models.dynamics import Dynamics
from ..models.joint_effects import without_joint_effects
from ..models.stacked import StackedDynamics
from ..robot.robot import Robot
from ..robot.workspace import reach
from .defaults import JOINT_MODE, KINEMATIC_MODE, PREDICTION_RATE, gradient_shape, inertial_mode
from .linearised_loop import LinearisedLoop, frequency, gain_matrix, rate_for


def kinematic_adaptation(
    kind: str,
    loop: LinearisedLoop,
    gains: Gains,
    bandwidth: float,
    gamma_k: ArrayLike | None,
    box: np.ndarray | None,
) -> Adaptation:
    """Return how the kinematic estimate moves, at a given rate or the default one, inside a box (2, p) or none."""
    size = loop.kinematics.size
    if kind == "none":
        return Frozen()
    if gamma_k is None:
        m = loop.kinematics.task.positions
        stiffness = float(np.linalg.eigvalsh((gains.K_P + gains.alpha * gains.K_v)[:m, :m])[-1])
        effects = [np.sqrt(stiffness) * Y_p for Y_p in loop.kinematic]
        gamma_k = rate_for(
            KINEMATIC_MODE * bandwidth, effects, Gradient(1.0, size), loop.kinematics.initial
        )
    gradient = Gradient(gamma_k, size, "gamma_k")
    return (
        gradient
        if box is None
        else BoxProjection(
            gradient, *box, names=loop.kinematics.names, where="unknown.kinematic_box"
        )
    )


def prediction_weight(loop: LinearisedLoop, adaptation: Adaptation, bandwidth: float) -> float:
    """Return R_k with which the prediction error decays at its share of the bandwidth over a typical motion."""
    rate = frequency(loop.kinematic, gain_matrix(adaptation, loop.kinematics.initial)) ** 2
    return PREDICTION_RATE * bandwidth / rate if rate > 0.0 else 1.0


def dynamic_adaptation(
    kind: str,
    believed: Robot,
    loop: LinearisedLoop,
    bandwidth: float,
    gamma_d: ArrayLike | None,
    gamma_joint: float | None,
    lmi: ArrayLike | MatrixInequality | None,
    share: float = 1.0,
) -> Adaptation:
    """Return how the dynamic estimate moves, at given rates or a share of the default ones.

    Raises:
        InputError: a rate or an inequality that does not fit the parameters.
    """
    dynamics = loop.dynamics
    if kind == "none" or not dynamics.size:
        return Frozen()
    bodies, joints = (
        mode * bandwidth * share**0.5 for mode in (inertial_mode(loop.law), JOINT_MODE)
    )
    inertial = dynamics.inertial if isinstance(dynamics, StackedDynamics) else dynamics
    effects = [Phi[:, : inertial.size] for Phi in loop.dynamic]
    adaptation: Adaptation = Frozen()
    if inertial.size and kind == "natural":
        cone = _cone(believed, inertial, lmi)
        unit = Natural(1.0, cone)
        rate = (
            rate_for(bodies, effects, unit, unit.admit(inertial.initial))
            if gamma_d is None
            else gamma_d
        )
        adaptation = _natural(rate, cone)
    elif inertial.size:
        carrier = without_joint_effects(believed) if dynamics is not inertial else believed
        Gamma = _gradient_gain(carrier, inertial, effects, bodies) if gamma_d is None else gamma_d
        projected = kind == "projected"
        adaptation = (
            MassMatrixProjection(Gamma, inertial, carrier)
            if projected
            else Gradient(Gamma, inertial.size, "gamma_d")
        )
    if not isinstance(dynamics, StackedDynamics) or not dynamics.joint.size:
        return adaptation
    joint = dynamics.joint
    if gamma_joint is None:
        effects = [Phi[:, inertial.size :] for Phi in loop.dynamic]
        gamma_joint = rate_for(
            joints, effects, ExponentiatedGradient(1.0, joint.typical), joint.typical
        )
    return Stacked(
        [
            (adaptation, inertial.size),
            (ExponentiatedGradient(gamma_joint, joint.typical), joint.size),
        ]
    )


def _gradient_gain(
    believed: Robot, dynamics: Dynamics, effects: list[np.ndarray], mode: float
) -> np.ndarray:
    """Return Gamma_d (p, p): how far the truth may be from the belief, at the rate with the fastest mode [rad/s]."""
    shape = gradient_shape(believed, dynamics, effects)
    return shape * rate_for(mode, effects, Gradient(shape, dynamics.size), dynamics.initial)


def _natural(rate: ArrayLike, cone: MatrixInequality) -> Natural:
    if np.ndim(rate) != 0:
        raise InputError("natural adaptation has one scalar gain.", where="gamma_d")
    return Natural(positive(rate, "gamma_d"), cone)


def _cone(
    believed: Robot, dynamics: Dynamics, lmi: ArrayLike | MatrixInequality | None
) -> MatrixInequality:
    """Return the bodies' cone, or the user's inequality for a basis."""
    cone: MatrixInequality
    if isinstance(dynamics, BodyDynamics):
        names = [believed.joint_names[body] for body in dynamics.bodies]
        mass = pin.computeTotalMass(believed.model) / believed.model.nv
        cone = BodyInequality(names, least_mass=1e-3 * mass, least_radius=1e-2 * reach(believed))
    elif lmi is None:
        raise ParameterError(
            "natural adaptation of a user's basis needs the inequality that keeps M positive definite.",
            where="unknown.lmi",
            hint='Give one (see robots/planar_2r/lmi.csv), or use adaptation = "gradient".',
        )
    else:
        cone = lmi if isinstance(lmi, MatrixInequality) else MatrixInequality(lmi)
    if cone.size != dynamics.size:
        raise ParameterError(
            f"the inequality has {cone.size} coefficients, there are {dynamics.size} parameters.",
            where="lmi",
        )
    return cone
