"""Running the cases of a sweep: on processes of this machine, any executor, or in this process.

The case travels to the worker, which makes the robot and the controller and sends back numbers. A
case that raises, diverges, hangs, or takes its process with it, is a row with its reason.
"""

from __future__ import annotations

import os
import pickle
import signal
import sys
import threading
import time
import traceback
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import (
    Executor,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    as_completed,
)
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import partial
from importlib import import_module
from inspect import signature
from multiprocessing import active_children, get_context, parent_process
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from .._checks import mapping, whole
from .._output import Record, check_writable, collect_seldom, read_toml
from ..exceptions import InputError
from ..rollout.recording import FOLLOWS, extreme
from ..rollout.rollout import Rollout
from ..scenario.scenario import Scenario
from ..scenario.tables import with_values
from .cases import COPY, Case, Function, Plan
from .table import (
    AGAIN,
    CRASHED,
    DIVERGED,
    DONE,
    FAILED,
    JOURNAL,
    REFUSED,
    TABLE,
    TIMEOUT,
    CaseTable,
    Row,
    append,
    join,
    read,
)

Work = Callable[[Case], Record]


# --- what is run ---


def scenario_of(tables: Record, folder: str, case: Case) -> Scenario:
    """Return the scenario of a case; its ``simulation.seed`` is the case's, unless varied.

    Raises:
        InputError: the values cannot be used.
    """
    return Scenario.build(
        with_values(tables, {"simulation.seed": case.seed, **case.values}), Path(folder)
    )


def run_scenario(tables: Record, folder: str, case: Case) -> Record:
    """Return the numbers of a case of a scenario, whose paths are relative to a folder."""
    return numbers_of(scenario_of(tables, folder, case).run(progress=False))


def run_function(function: Function, path: str, case: Case) -> Record:
    """Return what a function, or "module:name" in a folder, returns for the values of a case.

    It gets the seed too, if it has an argument ``seed``. What is no table is called "result".
    """
    function = resolved(function, path)
    seed = {"seed": case.seed} if "seed" in signature(function).parameters else {}
    found = function(**{**seed, **case.values})
    return found if isinstance(found, Mapping) else {"result": found}


def resolved(function: Function, path: str) -> Callable[..., Any]:
    """Return a function from its name, "module:name". Its module is a program, which runs now.

    Raises:
        InputError: there is no such module, or it has no such function.
    """
    if not isinstance(function, str):
        return function
    module, _, name = function.partition(":")
    if path and path not in sys.path:
        sys.path.insert(0, path)
    try:
        return getattr(import_module(module), name)
    except (ImportError, AttributeError, ValueError) as error:
        raise InputError(
            f"cannot be imported: {error}.",
            where=function,
            hint='Write "module:function"; the module is searched for from the folder of the '
            "sweep file.",
        ) from error


def work_of(plan: Plan) -> Work:
    """Return what a sweep runs for each case.

    Raises:
        InputError: a function cannot be imported.
    """
    if plan.scenario is not None:
        return partial(run_scenario, plan.scenario, plan.folder)
    function: Any = plan.function
    resolved(function, plan.path)
    return partial(run_function, function, plan.path)


# of ``summary.json``
_KEPT = (
    "error_share",
    "max_error_first",
    "max_error_last",
    "rms_error_last",
    "max_angle_last",
    "max_tool_error_last",
    "saturated",
    "diverged",
)


def numbers_of(rollout: Rollout) -> Row:
    """Return the numbers of a run that a sweep keeps; None where there is none.

    ``follows``: whether the verdict is "follows"; ``torque_use``: largest torque over its limit;
    ``error_share``, ``max_error_last``, ``diverged`` and others as in ``summary.json``.
    """
    limits = rollout.effort_limits
    found: Row = {
        "follows": rollout.grade == FOLLOWS,
        **{name: rollout.numbers[name] for name in _KEPT if name in rollout.numbers},
        "torque_use": extreme(np.max, (np.abs(rollout.tau) / limits)[:, np.isfinite(limits)]),
    }
    if rollout.diverged is not None:
        found |= {"status": DIVERGED, "reason": f"at {rollout.diverged:.3f} s: {rollout.reason}"}
    return found


# --- one case ---


class _TimeUp(BaseException):
    """The time of a case is up; no error that its function could handle."""


@contextmanager
def _within(seconds: float | None) -> Iterator[None]:
    """Raise ``_TimeUp`` after so many seconds, in the main thread, which alone gets signals."""

    def stop(number: int, frame: FrameType | None) -> None:
        """End the case."""
        raise _TimeUp

    if seconds is None or threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def run_case(work: Work, case: Case, timeout: float | None = None) -> Row:
    """Return the row of a case, whatever happens in it."""
    started = time.perf_counter()
    found: Row = {"status": DONE, "reason": None}
    try:
        with warnings.catch_warnings(), _within(timeout):
            warnings.simplefilter("ignore")  # the row says how the case ended
            found |= work(case)
    except InputError as error:
        found |= {"status": REFUSED, "reason": str(error)}
    except _TimeUp:
        found |= {"status": TIMEOUT, "reason": f"took longer than {timeout:g} s"}
    except Exception as error:
        last = traceback.extract_tb(error.__traceback__)[-1]
        reason = f"{type(error).__name__}: {error} ({Path(last.filename).name}:{last.lineno})"
        found |= {"status": FAILED, "reason": reason}
    return case.row({**found, "seconds": time.perf_counter() - started})


def _run(packed: bytes, timeout: float | None, case: Case) -> Row:
    """Run a case of pickled work; what cannot be imported here is a case that failed."""
    return run_case(lambda case: pickle.loads(packed)(case), case, timeout)


# --- processes ---


def _begin() -> None:
    """Prepare a new process: it ends with its parent, and leaves Ctrl-C to that."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    collect_seldom()
    threadpool_limits(1, "blas")
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
    os._exit(1)


def _in_own_process(own: threading.local, task: Callable[[Case], Row], case: Case) -> Row:
    """Run a case in the process of this thread, which is started at first, and when it has died.

    Raises:
        InputError: no process can be started.
        BrokenProcessPool: the process died with the case.
    """
    try:
        own.pool.submit(os.getpid).result()
    except (AttributeError, BrokenProcessPool):
        own.pool = ProcessPoolExecutor(1, get_context("spawn"), _begin)
        try:
            own.pool.submit(os.getpid).result()
        except BrokenProcessPool as error:
            raise InputError(
                "no process could be started.",
                where="executor",
                hint='In a script, put the call below `if __name__ == "__main__":`, because every '
                "process imports the script.",
            ) from error
    return own.pool.submit(task, case).result()


def _as_ended(
    executor: Executor, task: Callable[[Case], Row], cases: Iterable[Case]
) -> Iterator[Row]:
    """Yield the rows of cases as they end, or are lost with their process."""
    futures = {executor.submit(task, case): case for case in cases}
    try:
        for future in as_completed(futures):
            case = futures[future]
            error = future.exception()
            if error is None or isinstance(error, InputError):  # no process can be started
                yield future.result()
                continue
            reason = f"its process ended: {error!r}"
            yield case.row({"status": CRASHED, "reason": reason, "seconds": None})
    finally:
        for future in futures:
            future.cancel()


# --- all cases ---


def rows(
    plan: Plan, cases: Iterable[Case], executor: Executor | int | None = None
) -> Iterator[Row]:
    """Yield the rows of cases as they end.

    Args:
        plan: the sweep, which says what is run and how long a case may take.
        cases: to run.
        executor: any ``concurrent.futures.Executor``, which is left running; a number of processes,
            0 for this one; None: one process for each core.

    Raises:
        InputError: a function cannot be imported, or no process can be started.
    """
    work = work_of(plan)
    if not isinstance(executor, Executor | None):
        executor = whole(executor, "executor", 0)
    with threadpool_limits(1, "blas"):
        if executor == 0:  # nothing is pickled: any function will do
            for case in cases:
                yield run_case(work, case, plan.timeout)
            return
        task = partial(_run, pickle.dumps(work), plan.timeout)
        if isinstance(executor, Executor):
            yield from _as_ended(executor, task, cases)
            return
        others = set(active_children())
        threads = ThreadPoolExecutor(executor or len(os.sched_getaffinity(0)))  # its cores
        try:
            own = partial(_in_own_process, threading.local(), task)
            yield from _as_ended(threads, own, cases)
        finally:  # processes that the threads have started end, whatever they do then
            threads.shutdown(wait=False, cancel_futures=True)
            for process in set(active_children()) - others:
                process.kill()


# --- the whole sweep ---


def sweep(
    work: Path | str | Callable[..., Any],
    cases: Record | Sequence[Record],
    *,
    samples: int | None = None,
    method: str = "random",
    repeat: int = 1,
    seed: int = 0,
    executor: Executor | int | None = None,
    folder: Path | str | None = None,
    timeout: float | None = None,
) -> CaseTable:
    """Run a scenario, or a function, with many values and return one table.

    The table is the same to the bit in any order of the cases and on any executor, but for the time
    that each took. Each case has its own seed, ``numpy.random.SeedSequence(seed, spawn_key=(0,
    number))``; it is ``simulation.seed`` of a scenario, and the argument ``seed`` of a function
    that has one. A case that fails is a row with its ``status`` and ``reason``.

    Args:
        work: a scenario file, or a function of the values as keywords that returns numbers by name.
        cases: values by dotted key of the scenario, or by keyword of the function: lists, or texts
            such as "log(1, 100, 9)" and "uniform(0.5, 2)", see ``pinadapt.sweep.cases``; or a list
            of explicit cases.
        samples: number of samples of the distributions.
        method: of the samples: "random", "lhs" (Latin hypercube) or "sobol".
        repeat: runs of each case, each with its own seed.
        seed: of the sweep.
        executor: any ``concurrent.futures.Executor``; a number of processes, 0 for this one; None:
            a process for each core. A function has to be at the top of a module.
        folder: keeps the table while it grows; a folder of the same sweep is completed.
        timeout: [s] of a case.

    Raises:
        InputError: a value or a key is not allowed, the folder holds another sweep, or no case can
            run.
    """
    what: Row = {"function": work}
    if not callable(work):
        what = {"scenario": read_toml(Path(work)), "folder": str(Path(work).resolve().parent)}
    if isinstance(cases, Mapping):
        what["vary"] = cases
    else:
        what["case"] = [mapping(each, "cases") for each in cases]
    plan = Plan(**what, samples=samples, method=method, repeat=repeat, seed=seed, timeout=timeout)
    return run_plan(
        plan, executor, None if folder is None else claimed(Path(folder), plan, resume=True)
    )


def claimed(folder: Path, plan: Plan, *, resume: bool, anew: bool = False) -> Path:
    """Return a folder after writing the sweep into it, or after a check that it holds the same.

    Raises:
        InputError: it holds another sweep, or this one, without the option to resume it.
    """
    if anew or not (folder / COPY).is_file():
        check_writable(folder)
        for name in (TABLE, JOURNAL):
            (folder / name).unlink(missing_ok=True)
        plan.save(folder)
    elif not plan.is_in(folder):
        raise InputError(
            "holds another sweep, or one of another version or of files that have changed since.",
            where=folder,
            hint="Take another folder by --out, or begin anew by --force.",
        )
    elif not resume:
        raise InputError(
            f"holds this sweep already, {len(read(folder))} of {len(plan.cases)} cases.",
            where=folder,
            hint="Complete it by --resume, or begin anew by --force.",
        )
    return folder


def run_plan(
    plan: Plan,
    executor: Executor | int | None = None,
    folder: Path | None = None,
    *,
    retry: bool = False,
) -> CaseTable:
    """Run the cases of a sweep that have no row yet, and return the table of all.

    Args:
        plan: the sweep.
        executor: as of ``rows``.
        folder: that holds the rows, of one process at a time; None: memory.
        retry: whether what crashed, failed or took too long runs again.

    Raises:
        InputError: no case can run.
        OSError: a row could not be written; those before it are kept.
    """
    from tqdm import tqdm  # here, because workers need it not

    done = set[int]()
    if folder is not None:
        done.update(join(folder, AGAIN if retry else ())["case"])
    found = tqdm(
        rows(plan, (case for case in plan.cases if case.number not in done), executor),
        desc="sweep",
        total=len(plan.cases),
        initial=len(done),
        disable=None,  # but on a terminal
        leave=False,
    )
    if folder is None:
        return CaseTable(found)
    for row in found:
        append(folder, row)
    return join(folder)
