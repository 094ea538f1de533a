"""Whether a robot of the zoo converged, and if not, which hypothesis of the proof failed."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from ..controller.controller import Controller
from ..laws.acceleration_law import AccelerationLaw
from ..laws.law import Law
from ..laws.separation import Separation
from ..rollout.recording import extreme
from ..rollout.rollout import Rollout
from ..rollout.verdict import ACCURATE, BETTER
from ..tuning.preflight import lightest_joint
from .case import PERIOD, SWING, ZooCase

CONVERGED = "converged"
_SINGULAR = 0.2  # relative to the smallest singular value at the start


def last_error(case: ZooCase, rollout: Rollout) -> float | None:
    """Return the largest error at the end of a run [m], or None if none is finite.

    The end is 10 % of the case's duration, however long the run itself was.
    """
    return _last(case, rollout, rollout.distance)


def last_angle(case: ZooCase, rollout: Rollout) -> float | None:
    """Return the largest orientation error at the end [rad]; None without an orientation."""
    return None if rollout.angle is None else _last(case, rollout, rollout.angle)


def _last(case: ZooCase, rollout: Rollout, errors: np.ndarray) -> float | None:
    t = rollout.t
    return extreme(np.max, errors[t > t[-1:] - 0.1 * case.duration])


def verdict(case: ZooCase, controller: Controller, adapted: Rollout, unadapted: Rollout) -> str:
    """Return "converged", or the hypotheses that most likely failed."""
    error, without = last_error(case, adapted), last_error(case, unadapted)
    accurate = error is not None and error <= ACCURATE * case.radius
    if (angle := last_angle(case, adapted)) is not None:
        accurate = accurate and angle <= ACCURATE * SWING
    better = error is not None and without is not None and error <= BETTER * without
    if adapted.diverged is None and accurate and better:
        return CONVERGED
    checks = (_diverged, _unphysical, _light, _too_fast, _near_singularity)
    found = [flaw for check in checks if (flaw := check(case, controller, adapted)) is not None]
    if not found:
        found.append(_slow(case, adapted))
    if accurate and error and without is not None:
        found.append(f"accurate, but only {without / error:.1f} times better than without")
    return "; ".join(found)


def _diverged(case: ZooCase, controller: Controller, rollout: Rollout) -> str | None:
    if rollout.diverged is None:
        return None
    return f"diverged at {rollout.diverged:.2f} s: {str(rollout.reason).rstrip('.')}"


def _unphysical(case: ZooCase, controller: Controller, rollout: Rollout) -> str | None:
    adaptation, dynamics = controller.adaptation_d, controller.dynamics
    truth, start = dynamics.value(case.true), adaptation.validate(dynamics.initial)
    if truth is not None and adaptation.divergence(start, truth) is not None:
        return None
    return "the real inertias are not physical: the truth is outside the cone"


def _near_singularity(case: ZooCase, controller: Controller, rollout: Rollout) -> str | None:
    smallest = rollout.min_singular_J_hat
    near = np.nanmin(smallest) < _SINGULAR * smallest[0]
    return "close to a singularity" if near else None


def _slow(case: ZooCase, rollout: Rollout) -> str:
    """Return how far a run without a failed hypothesis came; theory bounds no convergence time."""
    before, last = (part.max() for part in np.array_split(rollout.distance, 3)[1:])
    return (
        f"no hypothesis failed within {case.duration:g} s; "
        f"the error of the last third is {last / before:.0%} of the second's"
    )


def _light(case: ZooCase, controller: Controller, rollout: Rollout) -> str | None:
    """Return which joint the model has too light for an unknown load, if the law can diverge."""
    assert controller.motion is not None  # make_controller sets it
    light = lightest_joint(controller.motion, controller.law)
    if light is None:
        return None
    return (
        f"{light.joint}, which moves {light.inertia:.2g} kg m^2 in the model, "
        f"tolerates unknown loads up to {light.load:.2g} kg only"
    )


def _too_fast(case: ZooCase, controller: Controller, rollout: Rollout) -> str | None:
    """Return which joint's true inertia is too small for the sampling period, if any is.

    The damping torque is -D qd with D = J_hat^T K_v J_hat, or M_hat J_hat^+ K_v J_hat for laws that
    command accelerations, or K_D + alpha M_hat J_hat^+ J_hat for the separation law. Held over a
    period dt it is stable as long as no eigenvalue of M^-1 D dt exceeds 2.
    """
    model, data, law = case.true.model, case.true.model.createData(), controller.law
    if not hasattr(law, "K_v"):
        return None
    for q, v, a_k, a_d in zip(rollout.q, rollout.v, rollout.a_k, rollout.a_d, strict=True):
        controller.kinematics.update(a_k, q, v)
        J = controller.kinematics.J
        controller.dynamics.load(a_d)
        D = _damping(law, J, controller.dynamics.mass_matrix(q))
        M = pin.crba(model, data, q)
        eigenvalues, vectors = np.linalg.eig(np.linalg.solve(M, D))
        if PERIOD * eigenvalues.real.max() > 2.0:
            joint = int(np.argmax(np.abs(vectors[:, np.argmax(eigenvalues.real)])))
            name, inertia = case.true.joint_names[joint], M[joint, joint]
            return f"1 kHz is too slow for {name}, which moves {inertia:.1g} kg m^2"
    return None


def _damping(law: Law, J: np.ndarray, M: np.ndarray) -> np.ndarray:
    """Return D (n, n) of the damping torque -D qd of a law with gain K_v, at J and M."""
    K_v = np.asarray(law.K_v)  # type: ignore[attr-defined]  # _too_fast has checked it
    if isinstance(law, Separation):
        return np.asarray(K_v + law.alpha * M @ np.linalg.pinv(J) @ J)
    return np.asarray(
        (M @ np.linalg.pinv(J) if isinstance(law, AccelerationLaw) else J.T) @ K_v @ J
    )
