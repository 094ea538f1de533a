"""Run the zoo: each chain with and without adaptation, and a verdict."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from multiprocessing import get_context

import numpy as np
import pinocchio as pin

from ..controller.controller import Controller
from ..exceptions import PinadaptError
from ..rollout.rollout import Rollout
from ..simulation.simulate import simulate
from ..tuning.light_joint import lightest_joint
from ..tuning.make_controller import make_controller
from .case import ZooCase, zoo_case

PERIOD = 1e-3  # [s]
BETTER, ACCURATE = 0.2, 0.02  # of the unadapted error; of the circle's radius
CONVERGED = "converged"
_UNKNOWN = ("viscous", "coulomb")
_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass(frozen=True)
class ZooRow:
    """What came out for one chain; None where nothing did.

    Attributes: robot: name in the catalogue. joints: number of joints. law: the law that ran.
        radius: of the circle [m]. unadapted, adapted: largest error in the last 10 % of the run,
        estimates frozen and adapted [m]. min_eig_M_hat: smallest eigenvalue of the estimated mass
        matrix over the adapted run. min_singular_J_hat: smallest singular value of the estimated
        Jacobian over the adapted run. verdict: "converged", or which hypothesis failed.
    """

    robot: str
    joints: int | None = None
    law: str | None = None
    radius: float | None = None
    unadapted: float | None = None
    adapted: float | None = None
    min_eig_M_hat: float | None = None
    min_singular_J_hat: float | None = None
    verdict: str = ""


def zoo_row(name: str, law: str, seed: int = 0) -> ZooRow:
    """Run one chain of the catalogue; whatever fails is told in the verdict."""
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore"
        )  # bodies that are not physical in the URDF; the verdict tells of them
        try:
            return _row(name, law, seed)
        except (PinadaptError, ArithmeticError, ValueError) as error:
            return ZooRow(name, law=law, verdict=f"refused: {error}")


def _row(name: str, law: str, seed: int) -> ZooRow:
    case = zoo_case(name, seed)
    controller = _controller(case, law, "natural")
    adapted, unadapted = _run(case, controller), _run(case, _controller(case, law, "none"))
    numbers, without = adapted.summary(), unadapted.summary()["max_error_last"]
    return ZooRow(
        robot=name,
        joints=case.true.model.nv,
        law=law,
        radius=case.radius,
        unadapted=without,
        adapted=numbers["max_error_last"],
        min_eig_M_hat=numbers["min_eig_M_hat"],
        min_singular_J_hat=numbers["min_singular_J_hat"],
        verdict=_verdict(case, controller, adapted, unadapted),
    )


def run_zoo(
    names: Sequence[str], law: str, *, seed: int = 0, processes: int | None = None
) -> Iterator[ZooRow]:
    """Run many chains over processes and yield their rows as they come.

    Args:
        names: of chains in the catalogue.
        law: a name of ``pinadapt.LAWS``.
        seed: of the cases.
        processes: how many at once, by default one a core.
    """
    for (
        variable
    ) in _THREADS:  # small matrices gain nothing from threads, and the processes share the cores
        os.environ.setdefault(variable, "1")
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        futures = {pool.submit(zoo_row, name, law, seed): name for name in names}
        for future in as_completed(futures):
            error = future.exception()
            yield (
                future.result()
                if error is None
                else ZooRow(futures[future], law=law, verdict=f"failed: {error!r}")
            )


def _controller(case: ZooCase, law: str, adaptation: str) -> Controller:
    return make_controller(case.believed, law=law, joint=_UNKNOWN, adaptation=adaptation, dt=PERIOD)


def _run(case: ZooCase, controller: Controller) -> Rollout:
    return simulate(
        case.true,
        controller,
        case.circle,
        duration=case.duration,
        dt=PERIOD,
        record_every=10,
    )


def _verdict(case: ZooCase, controller: Controller, adapted: Rollout, unadapted: Rollout) -> str:
    """Say whether a chain converged, and if not, which hypothesis of the proof is the likeliest to have failed."""
    error, without = adapted.summary()["max_error_last"], unadapted.summary()["max_error_last"]
    enough = error is not None and without is not None
    if (
        adapted.diverged is None
        and enough
        and error <= ACCURATE * case.radius
        and error <= BETTER * without
    ):
        return CONVERGED
    found = []
    if adapted.diverged is not None:
        found.append(f"diverged at {adapted.diverged:.2f} s: {str(adapted.reason).rstrip('.')}")
    truth = controller.dynamics.value(case.true)
    if (
        truth is None
        or controller.adaptation_d.distance(
            controller.adaptation_d.admit(controller.dynamics.initial), truth
        )
        is None
    ):
        found.append("the real inertias are not physical: the truth is outside the cone")
    found += [
        flaw
        for check in (_light, _too_light)
        if (flaw := check(case, controller, adapted)) is not None
    ]
    if np.nanmin(adapted.min_singular_J_hat) < 0.2 * adapted.min_singular_J_hat[0]:
        found.append("close to a singularity")
    if not found:
        found.append(_slow(case, adapted))
    if enough and error <= ACCURATE * case.radius:
        found.append(f"accurate, but only {without / error:.1f} times better than without")
    return "; ".join(found)


def _slow(case: ZooCase, rollout: Rollout) -> str:
    """Say how far a run came of which no hypothesis failed: the theorems promise convergence, but no time for it."""
    before, last = (part.max() for part in np.array_split(rollout.distance, 3)[1:])
    return f"no hypothesis failed within {case.duration:g} s; the error of the last third is {last / before:.0%} of the second's"


def _light(case: ZooCase, controller: Controller, rollout: Rollout) -> str | None:
    """Say which joint is believed too light for an unknown load, if the law can lose one."""
    assert controller.loop is not None  # make_controller gives one
    light = lightest_joint(case.believed, controller.loop, controller.law.gains)
    if light is None:
        return None
    return f"{light.joint}, believed to move {light.inertia:.2g} kg m^2, bears unknown loads up to {light.load:.2g} kg only"


def _too_light(case: ZooCase, controller: Controller, rollout: Rollout) -> str | None:
    """Say which joint's real inertia is too small for the sampling period, if the damping was too strong for one.

    The damping torque is -D qd, D = J_hat^T K_v J_hat for energy-based laws, M_hat J_hat^+ K_v
    J_hat for the others; held over a period it is stable while no eigenvalue of M^-1 D dt exceeds
    two.
    """
    model, data, K_v = case.true.model, case.true.model.createData(), controller.law.gains.K_v
    for q, v, a_k, a_d in zip(rollout.q, rollout.v, rollout.a_k, rollout.a_d, strict=True):
        controller.kinematics.update(a_k, q, v)
        J = controller.kinematics.J
        D = J.T @ K_v @ J
        if not controller.law.energy_based:
            controller.dynamics.load(a_d)
            D = controller.dynamics.mass_matrix(q) @ np.linalg.pinv(J) @ K_v @ J
        M = pin.crba(model, data, q)
        eigenvalues, vectors = np.linalg.eig(np.linalg.solve(M, D))
        if PERIOD * eigenvalues.real.max() > 2.0:
            joint = int(np.argmax(np.abs(vectors[:, np.argmax(eigenvalues.real)])))
            return f"1 kHz is too slow for {case.true.joint_names[joint]}, which moves {M[joint, joint]:.1g} kg m^2"
    return None
