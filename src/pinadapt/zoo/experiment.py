"""Run the zoo: each robot with and without adaptation, in parallel processes."""

from __future__ import annotations

import os
import signal
import threading
import warnings
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.connection import Connection

import numpy as np

from ..controller.controller import Controller
from ..controller.limits import Limits
from ..description.catalogue import catalogue, catalogue_entry
from ..exceptions import PinadaptError
from ..rollout.recording import extreme
from ..rollout.rollout import Rollout
from ..simulation.engine import Engine
from ..simulation.simulate import simulate
from ..tuning.make_controller import make_controller
from ..tuning.unknowns import Unknown
from .case import PERIOD, ZooCase, zoo_case
from .remarks import last_angle, last_error, verdict


@contextmanager
def workers(processes: int | None) -> Iterator[ProcessPoolExecutor]:
    """Yield a pool of new processes, by default one per core.

    Each waits for the end of a pipe to this process. The pipe closes when this process ends, even
    if it is killed, or when the work is cancelled; then all workers end at once.
    """
    context = get_context("spawn")
    listen, alive = context.Pipe(duplex=False)
    pool = ProcessPoolExecutor(processes, context, _end_with, (listen,))
    try:
        with pool:
            try:
                yield pool
            except BaseException:
                alive.close()
                raise
    finally:
        alive.close()
        listen.close()


@contextmanager
def deaf() -> Iterator[None]:
    """Let processes that are started inside ignore Ctrl-C; this process receives it afterwards."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _end_with(pipe: Connection) -> None:
    threading.Thread(target=_wait, args=(pipe,), daemon=True).start()


def _wait(pipe: Connection) -> None:
    """End this process when the other end of a pipe closes."""
    try:
        pipe.recv_bytes()
    except (EOFError, OSError):
        os._exit(1)


POSITION, POSE = "position", "pose"
_LEAST_JOINTS = 6  # for a pose task
_RECORD_EVERY = 10
_UNKNOWN = Unknown(friction=True, armature=True)  # the true robot has friction, the model has none
_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass(frozen=True)
class ZooRow:
    """The result for one robot; None where there is none.

    Attributes:
        robot: name in the catalogue.
        joints: number of joints.
        law: name of the law.
        task: "position" or "pose".
        radius: radius of the circle [m].
        unadapted: largest error in the last 10 % of the duration with frozen estimates [m].
        adapted: largest error in the last 10 % of the duration with adaptation [m].
        unadapted_angle: as ``unadapted``, for the orientation of a pose [rad].
        adapted_angle: as ``adapted``, for the orientation of a pose [rad].
        min_eig_M_hat: smallest eigenvalue of the estimated mass matrix over the adapted run.
        min_singular_J_hat: smallest singular value of the estimated Jacobian over the adapted run.
        verdict: "converged", or which hypothesis of the proof failed.
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
    task: str = POSITION
    unadapted_angle: float | None = None
    adapted_angle: float | None = None


def zoo_names(task: str = POSITION) -> list[str]:
    """Return the names of the robots of the catalogue for a task, "position" or "pose"."""
    least = _LEAST_JOINTS if task == POSE else 0
    return [name for name, entry in catalogue().items() if entry.joints >= least]


def zoo_row(name: str, law: str, seed: int = 0, task: str = POSITION) -> ZooRow:
    """Run one robot of the catalogue; the verdict says whether and why it failed."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the verdict reports bodies that are not physical
        try:
            return _row(name, law, seed, task)
        except (PinadaptError, ArithmeticError, ValueError) as error:
            return ZooRow(name, law=law, verdict=f"refused: {error}", task=task)


def _row(name: str, law: str, seed: int, task: str) -> ZooRow:
    case = zoo_case(name, seed, POSE if task == POSE else None)
    controller = _controller(case, law, "natural")
    adapted = _run(case, controller, case.duration)
    unadapted = _run(case, _controller(case, law, "none"), case.repeating)
    return ZooRow(
        robot=name,
        joints=case.true.model.nv,
        law=law,
        radius=case.radius,
        unadapted=last_error(case, unadapted),
        adapted=last_error(case, adapted),
        min_eig_M_hat=extreme(np.min, adapted.min_eig_M_hat),
        min_singular_J_hat=extreme(np.min, adapted.min_singular_J_hat),
        verdict=verdict(case, controller, adapted, unadapted),
        task=task,
        unadapted_angle=last_angle(case, unadapted),
        adapted_angle=last_angle(case, adapted),
    )


def run_zoo(
    names: Sequence[str],
    law: str,
    *,
    seed: int = 0,
    processes: int | None = None,
    task: str = POSITION,
) -> Generator[ZooRow, None, None]:
    """Run robots in parallel processes and yield their rows as they finish.

    Robots with most joints start first, so that the processes finish at about the same time.

    Args:
        names: names in the catalogue.
        law: name of a law.
        seed: seed of the cases.
        processes: number of processes; None: one per core.
        task: "position", or "pose" for robots with six and more joints.

    Raises:
        RobotError: a name is not in the catalogue.
    """
    longest_first = sorted(names, key=lambda name: -catalogue_entry(name).joints)
    for variable in _THREADS:  # threads do not speed up small matrices
        os.environ.setdefault(variable, "1")
    with workers(processes) as pool:
        with deaf():
            futures = {pool.submit(zoo_row, name, law, seed, task): name for name in longest_first}
        for future in as_completed(futures):
            error = future.exception()
            yield (
                future.result()
                if error is None
                else ZooRow(futures[future], law=law, verdict=f"failed: {error!r}", task=task)
            )


def _controller(case: ZooCase, law: str, adaptation: str) -> Controller:
    return make_controller(
        case.estimated,
        law=law,
        adaptation=adaptation,
        unknown=_UNKNOWN,
        limits=Limits(
            torque=case.efforts_suffice,
            guards={
                "velocity": False
            },  # the simulated sensors are right: implausible speed is divergence
        ),
        dt=PERIOD,
    )


def _run(case: ZooCase, controller: Controller, duration: float) -> Rollout:
    return simulate(
        case.true,
        controller,
        case.motion,
        duration=duration,
        engine=Engine(torque_limits=case.efforts_suffice),
        record_every=_RECORD_EVERY,
        progress=False,
    )
