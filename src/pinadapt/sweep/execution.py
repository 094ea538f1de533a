"""Running the cases of a sweep: on processes of this machine, any executor, or in this process.

The case travels to the worker, which makes the robot and the controller, keeps them for the next
case that has the same, and sends back numbers. A case that raises, diverges, hangs, or takes its
process with it, is a row with its reason.
"""

from __future__ import annotations

import importlib
import os
import pickle
import signal
import sys
import threading
import time
import traceback
import warnings
from collections import OrderedDict, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import dataclass
from functools import lru_cache, partial
from inspect import Parameter, signature
from multiprocessing import active_children, get_context, parent_process
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from .._checks import shown
from .._output import check_writable, collect_seldom, read_toml
from .._version import __version__
from ..exceptions import InputError
from ..rollout.recording import extreme
from ..rollout.rollout import Rollout
from ..rollout.summary import FOLLOWS
from ..scenario.scenario import Scenario
from ..scenario.tables import with_values
from .cases import COPY, Case, Plan
from .table import (
    AGAIN,
    CRASHED,
    DIVERGED,
    DONE,
    FAILED,
    REFUSED,
    TIMEOUT,
    CaseTable,
    Store,
    read,
    remove,
)

Work = Callable[[Case], Mapping[str, Any]]
Ended = tuple[Case, "Future[dict[str, Any]]"]

_KEPT = 4  # robots and controllers that a worker keeps; half: made again more often; twice: memory
_AHEAD = 2  # cases for each worker of a given executor; one: workers wait; four: nothing is gained
_IMPORTABLE = (
    "A function must stand at the top of a module that all workers can import, not in a shell, a "
    "notebook or another function."
)


class EngineError(InputError):
    """Processes or an executor that cannot run any case."""


# --- what is run ---


@dataclass(frozen=True)
class ScenarioWork:
    """A scenario, run with other values.

    Attributes:
        raw: its tables.
        folder: to which its paths are relative.
        reduce: returns the numbers of a rollout by name, or "module:name"; None: ``numbers_of``.
        path: folder in which the module of ``reduce`` is.
    """

    raw: Mapping[str, Any]
    folder: str
    reduce: Callable[[Rollout], Mapping[str, Any]] | str | None = None
    path: str = ""

    def scenario(self, case: Case) -> Scenario:
        """Return the scenario of a case; its ``simulation.seed`` is the case's, unless varied.

        Raises:
            InputError: the values cannot be used.
        """
        values = {"simulation.seed": case.seed, **case.values}
        tables = with_values(deepcopy(dict(self.raw)), values)
        return Scenario.build(tables, Path(self.folder), _kept())

    def __call__(self, case: Case) -> Mapping[str, Any]:
        """Return the numbers of a case."""
        rollout = self.scenario(case).run(progress=False)
        reduce = numbers_of if self.reduce is None else resolved(self.reduce, self.path)
        return reduce(rollout)


@dataclass(frozen=True)
class FunctionWork:
    """A function of the values of a case, and of its seed where it has an argument ``seed``.

    Attributes:
        function: it, or "module:name".
        path: folder in which the module is, which workers import it from; empty: installed.
    """

    function: Callable[..., Any] | str
    path: str = ""

    def __call__(self, case: Case) -> Mapping[str, Any]:
        """Return what the function returns; what is no table is called "result"."""
        function = resolved(self.function, self.path)
        arguments = signature(function).parameters
        takes_all = any(each.kind is Parameter.VAR_KEYWORD for each in arguments.values())
        seeded = "seed" not in case.values and ("seed" in arguments or takes_all)
        found = function(**case.values, **({"seed": case.seed} if seeded else {}))
        return found if isinstance(found, Mapping) else {"result": found}


def resolved(function: Callable[..., Any] | str, path: str = "") -> Callable[..., Any]:
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
        found: Callable[..., Any] = getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError, ValueError) as error:
        raise InputError(
            f"cannot be imported: {error}.",
            where=function,
            hint='Write "module:function"; the module is searched for from the folder of the '
            "sweep file.",
        ) from error
    return found


def numbers_of(rollout: Rollout) -> dict[str, Any]:
    """Return the numbers of a run that a sweep keeps; None where there is none.

    ``follows``: whether the verdict is "follows"; ``error_share``, ``max_error_first``,
    ``max_error_last`` and ``rms_error_last`` as in ``summary.json``; ``worst_after_change`` and
    ``time_back``: of the worst event during the run; ``torque_use``: largest torque over its
    limit; ``saturated``: share of samples with a motor at its limit; ``diverged``: when [s]. Errors
    of a picture are ``max_pixels_first``, ``max_pixels_last`` and ``rms_pixels_last``, with
    ``max_tool_error_last`` in metres.
    """
    t, shown = rollout.transients, rollout.task.groups[0].display
    scale, error = (1.0, "error") if shown is None else (shown.scale, "pixels")
    first, last = (scale * rollout.window(first) for first in (True, False))
    back = [each.back for each in t]
    limits = rollout.effort_limits
    used = np.abs(rollout.tau) / limits
    found: dict[str, Any] = {
        "follows": rollout.grade == FOLLOWS,
        "error_share": rollout.error_share,
        f"max_{error}_first": extreme(np.max, first),
        f"max_{error}_last": extreme(np.max, last),
        f"rms_{error}_last": extreme(lambda x: float(np.sqrt(np.mean(x**2))), last),
        "torque_use": extreme(np.max, used[:, np.isfinite(limits)]),
        "saturated": extreme(np.mean, rollout.saturated),
        "diverged": rollout.diverged,
    }
    if rollout.beside_picture is not None:
        found["max_tool_error_last"] = rollout.beside_picture
    if rollout.angle is not None:
        found["max_angle_last"] = extreme(np.max, rollout.angle[-len(last) :])
    if t:
        found["worst_after_change"] = extreme(
            np.max, np.array([each.worst for each in t], dtype=float)
        )
        found["time_back"] = (
            None if None in back else max(each for each in back if each is not None)
        )
    if rollout.diverged is not None:
        found |= {"status": DIVERGED, "reason": f"at {rollout.diverged:.3f} s: {rollout.reason}"}
    return found


_local = threading.local()


class _Kept(OrderedDict[Any, Any]):
    """The last few robots and controllers that were made, by what they were made from."""

    def once(self, kind: str, of: str, make: Callable[[], Any]) -> Any:
        """Return what was made before, or make it; it is made from nothing but ``of``."""
        key = (kind, of)
        if key not in self:
            self[key] = make()
            for old in [each for each in self if each[0] == kind][:-_KEPT]:
                del self[old]
        self.move_to_end(key)
        return self[key]


def _kept() -> _Kept:
    """Return what this thread keeps: a controller has scratch memory, so no two may share it."""
    if not hasattr(_local, "kept"):
        _local.kept = _Kept()
    found: _Kept = _local.kept
    return found


# --- one case ---


class _TimeUp(BaseException):
    """The time of a case is up; no error that its function could handle."""


@contextmanager
def _within(seconds: float | None) -> Iterator[None]:
    """Raise ``_TimeUp`` after so many seconds, where the system has such signals."""

    def stop(number: int, frame: FrameType | None) -> None:
        """End the case."""
        raise _TimeUp

    main = threading.current_thread() is threading.main_thread()
    if seconds is None or not main or not hasattr(signal, "SIGALRM"):
        yield
        return
    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def run_case(
    work: Work, case: Case, version: str = __version__, timeout: float | None = None
) -> dict[str, Any]:
    """Return the row of a case, whatever happens in it: status, reason, numbers, seconds.

    Raises:
        EngineError: this process has another version of the library than the one that asks.
    """
    if version != __version__:
        raise EngineError(
            f"pinadapt {version} asks, but a worker has pinadapt {__version__}. Install the same "
            "version on all workers."
        )
    started, found = time.perf_counter(), dict[str, Any]()
    try:
        with warnings.catch_warnings(), _within(timeout):
            warnings.simplefilter("ignore")  # the row says how the case ended
            found = dict(work(case))
        head = {"status": found.pop("status", DONE), "reason": found.pop("reason", None)}
    except InputError as error:
        head = {"status": REFUSED, "reason": str(error)}
    except _TimeUp:
        head = {"status": TIMEOUT, "reason": f"took longer than {timeout:g} s"}
    except Exception as error:
        last = traceback.extract_tb(error.__traceback__)[-1]
        place = f"{Path(last.filename).name}:{last.lineno}"
        head = {"status": FAILED, "reason": f"{type(error).__name__}: {error} ({place})"}
    return {**head, **found, "seconds": time.perf_counter() - started}


def _run(packed: bytes, version: str, timeout: float | None, case: Case) -> dict[str, Any]:
    """Run a case of pickled work.

    Raises:
        EngineError: the work cannot be imported here, or the versions differ.
    """
    return run_case(_unpacked(packed), case, version, timeout)


@lru_cache(maxsize=2)
def _unpacked(packed: bytes) -> Work:
    try:
        work: Work = pickle.loads(packed)
    except Exception as error:
        raise EngineError(f"a worker cannot import what is run: {error}. {_IMPORTABLE}") from error
    return work


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


def cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@contextmanager
def _pool(count: int) -> Iterator[ProcessPoolExecutor]:
    """Yield new processes, which end with the block, whatever they do then.

    Raises:
        EngineError: none can be started.
    """
    others = set(active_children())
    pool = ProcessPoolExecutor(count, get_context("spawn"), _begin)
    try:
        pool.submit(os.getpid).result()
        yield pool
    except BrokenProcessPool as error:
        raise EngineError(
            "no process could be started. In a script, the call must be below "
            '`if __name__ == "__main__":`, because every process imports the script.'
        ) from error
    finally:
        for process in set(active_children()) - others:
            process.kill()
        pool.shutdown(cancel_futures=True)


def _in_processes(
    task: Callable[[Case], Any], cases: Iterable[Case], count: int
) -> Iterator[Ended]:
    """Yield cases with their results as they end.

    A process that dies takes its pool with it. What was in that pool runs again, each case in a
    pool of its own, so that the one that kills its process is known.
    """
    coming, again = iter(cases), deque[Case]()
    while True:
        alone = bool(again)
        source = iter([again.popleft()]) if alone else coming
        with _pool(1 if alone else count) as pool:
            for case, future in _as_ended(pool, task, source, 1 if alone else count):
                if isinstance(future.exception(), BrokenProcessPool) and not alone:
                    again.append(case)
                else:
                    yield case, future
        if not (again or alone):
            return


def _as_ended(
    executor: Executor, task: Callable[[Case], Any], coming: Iterator[Case], ahead: int
) -> Iterator[Ended]:
    """Yield cases with their results as they end, until there are no more or the pool is broken."""
    running: dict[Future[dict[str, Any]], Case] = {}
    broken = False
    try:
        while True:
            while not broken and len(running) < ahead and (case := next(coming, None)) is not None:
                running[_submitted(executor, task, case)] = case
            if not running:
                return
            done, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in done:
                broken = broken or isinstance(future.exception(), BrokenProcessPool)
                yield running.pop(future), future
    finally:
        for future in running:
            future.cancel()


def _submitted(
    executor: Executor, task: Callable[[Case], Any], case: Case
) -> Future[dict[str, Any]]:
    try:
        return executor.submit(task, case)
    except BrokenProcessPool as error:  # a process died while it had nothing to do
        future: Future[dict[str, Any]] = Future()
        future.set_exception(error)
        return future


# --- all cases ---


def rows(
    work: Work,
    cases: Iterable[Case],
    executor: Executor | int | None = None,
    timeout: float | None = None,
) -> Iterator[dict[str, Any]]:
    """Yield the rows of cases as they end; few cases are in work at a time.

    Args:
        work: what is run.
        cases: to run.
        executor: any ``concurrent.futures.Executor``, which is left running; a number of processes,
            0 for this one; None: one process for each core.
        timeout: [s] of a case.

    Raises:
        EngineError: no case can run.
        InputError: the work cannot be sent to other processes.
    """
    with threadpool_limits(1, "blas"):
        if executor == 0:  # nothing is pickled: any function will do
            for case in cases:
                yield _row(case, run_case(work, case, timeout=timeout))
            return
        try:
            task = partial(_run, pickle.dumps(work), __version__, timeout)
        except Exception as error:
            raise InputError(
                f"cannot be sent to other processes: {error}.",
                where="function",
                hint=f"{_IMPORTABLE} Or run it in this process: executor=0.",
            ) from error
        if isinstance(executor, Executor):
            workers = getattr(executor, "_max_workers", cores())
            found = _as_ended(executor, task, iter(cases), _AHEAD * workers)
        else:
            found = _in_processes(task, cases, executor or cores())
        for case, future in found:
            yield _row(case, _result(future))


def _result(future: Future[dict[str, Any]]) -> dict[str, Any]:
    """Return what came of a case.

    Raises:
        EngineError: no case can run.
    """
    error = future.exception()
    if isinstance(error, EngineError):
        raise error
    if error is None:
        return future.result()
    reason = f"lost by the executor: {type(error).__name__}: {error}"
    if isinstance(error, BrokenProcessPool):
        reason = "its process ended: killed, out of memory, or a crash of compiled code"
    return {"status": CRASHED, "reason": reason, "seconds": None}


def _row(case: Case, found: dict[str, Any]) -> dict[str, Any]:
    """Return the row of a case that has ended: parameters first, then what came of them."""
    head = {"status": found.pop("status"), "reason": found.pop("reason")}
    taken = {"case", "seed", *case.values}
    results = {
        f"{key} (result)" if key in taken else key: value
        for key, value in found.items()
        if not (key in case.values and case.values[key] == value)
    }
    return {"case": case.number, "seed": case.seed, **case.values, **head, **results}


# --- the whole sweep ---


def work_of(plan: Plan) -> ScenarioWork | FunctionWork:
    """Return what a sweep runs for each case.

    Raises:
        InputError: a function cannot be imported.
    """
    for function in (plan.function, plan.reduce):
        if function is not None:
            resolved(function, plan.path)
    if plan.function is not None:
        return FunctionWork(plan.function, plan.path)
    assert plan.scenario is not None
    return ScenarioWork(plan.scenario, plan.folder, plan.reduce, plan.path)


def sweep(
    work: Path | str | Callable[..., Any],
    cases: Mapping[str, Any] | Sequence[Mapping[str, Any]],
    *,
    samples: int | None = None,
    method: str = "random",
    repeat: int = 1,
    seed: int = 0,
    executor: Executor | int | None = None,
    reduce: Callable[[Rollout], Mapping[str, Any]] | None = None,
    folder: Path | str | None = None,
    timeout: float | None = None,
    progress: bool | None = None,
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
            a process for each core. Functions and ``reduce`` have to be at the top of a module.
        reduce: returns what is kept of a rollout, numbers by name; None: ``numbers_of``.
        folder: keeps the table while it grows; a folder of the same sweep is completed.
        timeout: [s] of a case, on systems with alarm signals.
        progress: whether to show a bar; None: if standard error is a terminal.

    Raises:
        InputError: a value or a key is not allowed, or the folder holds another sweep.
        EngineError: no case can run.
    """
    tables: dict[str, Any] = {"samples": samples, "method": method, "repeat": repeat, "seed": seed}
    tables |= {"timeout": timeout, "reduce": reduce}
    if isinstance(cases, Mapping):
        tables["vary"] = dict(cases)
    elif cases and all(isinstance(each, Mapping) for each in cases):
        tables["case"] = list(cases)
    else:
        raise InputError(
            f"expected values by key, or a list of them, got {shown(cases)}.", where="cases"
        )
    if callable(work):
        tables["function"] = work
    else:
        path = Path(work)
        tables |= {"scenario": read_toml(path), "folder": str(path.resolve().parent)}
    plan = Plan.of({key: value for key, value in tables.items() if value is not None})
    place = None if folder is None else claimed(Path(folder), plan, resume=True)
    return run_plan(plan, executor, place, shown=progress)


def claimed(folder: Path, plan: Plan, *, resume: bool, anew: bool = False) -> Path:
    """Return a folder after writing the sweep into it, or after a check that it holds the same.

    Raises:
        InputError: it holds another sweep, or this one, without the option to resume it.
    """
    if not (folder / COPY).is_file() or anew:
        check_writable(folder)
        folder.mkdir(parents=True, exist_ok=True)
        remove(folder)
        plan.save(folder)
        return folder
    if different := plan.differs(Plan.load(folder)):
        raise InputError(
            f"holds another sweep; different: {', '.join(different)}.",
            where=str(folder),
            hint="Choose another folder by --out, or begin anew by --force.",
        )
    if not resume:
        raise InputError(
            f"holds this sweep already, {len(read(folder))} of {len(plan.cases)} cases.",
            where=str(folder),
            hint="Complete it by --resume, or begin anew by --force.",
        )
    return folder


def run_plan(
    plan: Plan,
    executor: Executor | int | None = None,
    folder: Path | None = None,
    *,
    retry: bool = False,
    shown: bool | None = None,
) -> CaseTable:
    """Run the cases of a sweep that have no row yet, and return the table of all.

    Args:
        plan: the sweep.
        executor: as of ``rows``.
        folder: that holds the rows; None: memory.
        retry: whether what crashed, failed or took too long runs again.
        shown: whether to show a bar; None: on a terminal.

    Raises:
        EngineError: no case can run.
        OSError: a row could not be written; those before it are kept.
    """
    work = work_of(plan)
    if folder is None:
        found = rows(work, plan.cases, executor, plan.timeout)
        return CaseTable.of(list(_watched(found, plan, 0, shown)))
    with Store(folder) as store:
        if retry:
            store.join(without=AGAIN)
        done = store.done()
        missing = (case for case in plan.cases if case.number not in done)
        found = rows(work, missing, executor, plan.timeout)
        for row in _watched(found, plan, len(done), shown):
            store.add(row)
        return store.join()


def _watched(
    found: Iterator[dict[str, Any]], plan: Plan, done: int, shown: bool | None
) -> Iterator[dict[str, Any]]:
    """Yield rows, with a bar that counts them and those that are lost; None: on a terminal."""
    from tqdm import tqdm

    disable = None if shown is None else not shown
    total, lost = len(plan.cases), 0
    with tqdm(total=total, initial=done, desc="sweep", disable=disable, leave=False) as bar:
        for row in found:
            lost += row["status"] != DONE
            bar.set_postfix_str(f"{lost} lost" if lost else "", refresh=False)
            bar.update()
            yield row
