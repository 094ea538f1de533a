"""The bandwidth of the default gains, and the prior covariance of the parameters.

The bandwidth is w = 20 rad/s sqrt(2.2 m / reach), or the law's own, and at most 0.075 / dt for slow
loops: gravity and the centrifugal forces of similar motions accelerate a robot
of reach L at the rate sqrt(g / L), so that a model error then displaces every robot by the same
fraction of its size. Each law states its own
gains for a bandwidth (``Law.tuned``); where the check before a run finds the feedback too fast for
dt, w is lowered until it passes.

The rates of adaptation follow from the frequency of the closed loop (see ``frequency``): over a
typical motion the fastest mode of the bodies' adaptation is ``Law.adaptation_mode`` w, that
of the joints' coefficients ``Law.joint_mode`` w, that of the kinematics ``Law.kinematic_mode`` w,
and R_k lets the prediction error decay at w / 8. On the Panda gamma_k of the published laws is
about the 0.05 that Wang and Xie took for their arm.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..adaptation.adaptation import Adaptation, Estimate
from ..adaptation.natural import BodyInequality
from ..models.bodies import UNCERTAINTY, from_pseudo_inertia, nearest_physical, pseudo_inertia
from ..models.dynamics import Dynamics
from ..models.translations import placed_values
from ..models.typical_motion import TypicalMotion
from ..robot.motors import Actuators
from ..robot.robot import Robot


def frequency(effects: ArrayLike, Gamma: np.ndarray) -> float:
    """Return the median over the states of sqrt of the largest eigenvalue of Phi Gamma Phi^T."""
    Phi = np.array(effects)
    if not Phi.size:
        return 0.0
    largest = np.linalg.eigvalsh(Phi @ Gamma @ Phi.swapaxes(1, 2))[:, -1]
    return float(np.sqrt(max(np.median(largest), 0.0)))


def rate_for(mode: float, effects: ArrayLike, unit: Adaptation, at: Estimate) -> float:
    """Return the rate gamma at which the ``frequency`` is ``mode`` [rad/s].

    Args:
        mode: the wanted frequency [rad/s].
        effects: Phi (., p) at each state.
        unit: the adaptation at rate one.
        at: the estimate at which to look.
    """
    natural = frequency(effects, unit.gain(at))
    return (mode / natural) ** 2 if natural > 0.0 else 1.0


# relative standard deviations; half, twice of the second: the same runs of the published laws
INERTIA, LENGTH = UNCERTAINTY, 0.1
_OWN, _COMMON = 0.1134, 0.0167  # second moments of exp(0.3 W) - 1, by six million samples


def prior_covariance(robot: Robot, dynamics: Dynamics) -> np.ndarray | None:
    """Return E[da da^T] (p, p) of the errors of a robot's inertial parameters.

    None where plausible true robots have no values of these parameters.

    The truths are those of ``plausible``, ten per parameter. To first order the covariance of a
    whole body is 0.09 times the inverse of the metric of natural adaptation at the nominal body:
    like that metric it does not depend on frames and units.
    """
    robot = dynamics.bare(robot)
    dynamics = dynamics.inertial
    nominal = dynamics.value(robot)
    if nominal is None:
        return None
    values = dynamics.values(robot, *plausible(robot, dynamics, 10 * dynamics.size))
    if values is None:
        return None
    errors = values - nominal
    covariance = errors.T @ errors / max(len(errors), 1)
    variances = np.diag(covariance)
    # a millionth of its own variance for each parameter: no combination is known exactly
    return covariance + 1e-6 * np.diag(variances) if (variances > 0.0).all() else None


def prior_variances(robot: Robot, dynamics: Dynamics) -> np.ndarray | None:
    """Return the diagonal (p) of ``prior_covariance``, of whole bodies without samples.

    The moments of exp(0.3 W) - 1 do not depend on directions, so that a body with parameters a (10)
    has the covariance 0.1134 H^-1 + 0.0167 a a^T, H the metric of natural adaptation at a. To first
    order in 0.3 it is 0.09 H^-1.
    """
    if not dynamics.inertial.per_body:
        covariance = prior_covariance(robot, dynamics)
        return None if covariance is None else np.diag(covariance)
    robot = dynamics.bare(robot)
    bodies = dynamics.inertial.bodies
    S = _roots(robot, bodies)
    a = from_pseudo_inertia(S @ S.swapaxes(-1, -2)).ravel()
    cone = BodyInequality([robot.joint_names[body] for body in bodies])
    inverse = cone.metric_inverse_times(a, np.eye(a.size), np.ones(len(bodies)))
    return _OWN * np.diag(inverse) + _COMMON * a**2


def plausible(robot: Robot, dynamics: Dynamics, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return bodies (count, b, 10) and lengths (count, k) as they may be in truth, seeded.

    The pseudo-inertia P = S S^T of an unknown body becomes S exp(0.3 W) S^T, W symmetric and normal
    with density exp(-tr(W W) / 2): physical, and off by 30 %. Unknown translations are off by 10 %
    of their lengths.
    """
    S = _roots(robot, dynamics.bodies)
    values = placed_values(robot.model, robot.frame_id, dynamics.translations)
    sizes = [np.full(each.shape, np.sqrt(np.mean(each**2))) for each in values]
    theta, size = (np.concatenate([np.zeros(0), *each]) for each in (values, sizes))
    drawn = np.random.default_rng(0).standard_normal((count, S.size + theta.size))
    G = drawn[:, : S.size].reshape(count, *S.shape)
    w, U = np.linalg.eigh(0.5 * INERTIA * (G + G.swapaxes(-1, -2)))
    A = S @ U
    P = (A * np.exp(w)[..., None, :]) @ A.swapaxes(-1, -2)
    return from_pseudo_inertia(P), theta + LENGTH * size * drawn[:, S.size :]


def _roots(robot: Robot, bodies: Sequence[int]) -> np.ndarray:
    """Return S (b, 4, 4), P = S S^T the pseudo-inertias of b bodies or physical ones close by."""
    mass = robot.mass / robot.model.nv
    inertial = [robot.model.inertias[body + 1].toDynamicParameters() for body in bodies]
    near = [
        pseudo_inertia(nearest_physical(pi, least_mass=1e-3 * mass, least_radius=1e-3))
        for pi in inertial
    ]
    return np.linalg.cholesky(np.array(near).reshape(-1, 4, 4))


_PUBLISHED, _REACH = 20.0, 2.2  # [rad/s], [m], of Wang and Xie's arm
_LARGEST_STEP = 0.075  # bandwidth times sampling period; half: slow loops are half as fast


def usual_bandwidth(robot: Robot, own: float | None = None) -> float:
    """Return the bandwidth [rad/s] at short periods: that of the law, None: by the reach."""
    return _PUBLISHED * (_REACH / max(robot.reach, 1e-6)) ** 0.5 if own is None else own


def bandwidth(robot: Robot, dt: float, own: float | None = None) -> float:
    """Return the default bandwidth w [rad/s] for a robot at sampling period dt [s].

    ``own`` is that of the law, see ``Law.own_bandwidth`` [rad/s].
    """
    return min(usual_bandwidth(robot, own), _LARGEST_STEP / dt)


def feedback_lag(robot: Robot, dt: float, actuators: Actuators) -> float:
    """Return the lag [s] of K_D with actuators: 1 / lag is the fastest decay that it causes.

    Twice the time until a held torque acts: two periods for motors without delay. Springs add
    1 / ``elastic_mode``: a stiff motor lets its link oscillate on the spring, a compliant one damps
    it.

    Args:
        robot: the model.
        dt: sampling period [s].
        actuators: of the robot.

    Raises:
        InputError: actuators of another number of joints.
    """
    own = actuators.of(robot)
    late = np.max(dt + own.delay + 1.0 / own.bandwidth)
    return 2.0 * late + 1.0 / elastic_mode(robot, actuators)


def elastic_mode(robot: Robot, actuators: Actuators) -> float:
    """Return the lowest frequency [rad/s] of the links on their springs, the motors held, at home.

    Infinite for rigid joints.

    Raises:
        InputError: actuators of another number of joints.
    """
    if not actuators.elastic:
        return np.inf
    M = pin.crba(robot.model, robot.model.createData(), robot.q0) - np.diag(robot.model.armature)
    soft = np.sqrt(1.0 / actuators.of(robot).stiffness)
    return np.linalg.eigvalsh(soft[:, None] * M * soft)[-1] ** -0.5


def gradient_shape(robot: Robot, dynamics: Dynamics, effects: ArrayLike) -> np.ndarray:
    """Return a constant Gamma_d (p, p) up to a factor, which follows from the fastest mode.

    It is the covariance of the parameters' errors when inertias are off by 30 % and lengths by
    10 %: the estimate moves in the directions in which the truth may lie, each at its own scale,
    and V weighs an error by how unlikely it is. Where no plausible truth has a value in these
    parameters, as in most bases of a user's own, it is Niemeyer and Slotine's: the inverse diagonal
    of the mean of Phi^T Phi over a typical motion (*Performance in adaptive manipulator control*,
    1991).

    Args:
        robot: the model.
        dynamics: the parameters, made for it.
        effects: Phi of the loop at typical states.
    """
    covariance = prior_covariance(robot, dynamics)
    if covariance is not None:
        return covariance
    excitation = np.mean(np.sum(np.square(effects), axis=1), axis=0)
    return np.diag(1.0 / np.maximum(excitation, 1e-6 * excitation.max(initial=1e-12)))


def quiet_start(adaptation: Adaptation, value: np.ndarray) -> Estimate:
    """Return a value (p) moved into the adaptation's domain, as at a start, without a warning."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the start of a run warns of bodies outside of the cone
        return adaptation.init(value)


def typical_torques(adaptation: Adaptation, motion: TypicalMotion) -> np.ndarray:
    """Return the mean diagonal (n) of Y Gamma Y^T over a typical motion, positive.

    Joints whose torques show no parameter count as noise: theirs are the largest, times 1e12.
    """
    mean = mean_diagonal(adaptation, motion, motion.regressors)
    largest = max(mean.max(initial=0.0), 1e-300)
    return np.where(mean > 1e-12 * largest, mean, 1e12 * largest)


def mean_diagonal(
    adaptation: Adaptation, motion: TypicalMotion, regressors: ArrayLike
) -> np.ndarray:
    """Return the mean diagonal (n) of Y Gamma Y^T over regressors Y (n, p)."""
    Y = np.array(regressors)
    X = Y.reshape(len(Y) * Y.shape[1], -1).T
    start = quiet_start(adaptation, motion.dynamics.typical)
    squares = np.sum(X * adaptation.gain_times(start, X), axis=0)
    return squares.reshape(Y.shape[:2]).mean(axis=0)
