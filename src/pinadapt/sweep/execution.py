"""Running the cases of a sweep: on processes of this machine, a cluster, or in this process.

An engine is any ``concurrent.futures.Executor``. The case travels to the worker, which makes the
robot and the controller, keeps them for the next case that has the same, and sends back numbers.
A case that raises, diverges, hangs, or takes its process with it, is a row with its reason.
"""

from __future__ import annotations

import gc
import importlib
import os
import pickle
import signal
import sys
import threading
import time
import traceback
import warnings
from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    wait,
)
from concurrent.futures import TimeoutError as FutureTimeout
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from copy import deepcopy
from dataclasses import dataclass
from functools import lru_cache, partial
from inspect import Parameter, signature
from multiprocessing import get_context, parent_process
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from .._output import check_writable, percent, read_toml
from .._version import __version__
from ..exceptions import InputError
from ..rollout.recording import extreme
from ..rollout.rollout import Rollout
from ..rollout.summary import FOLLOWS
from ..scenario.scenario import Scenario
from ..scenario.schema import tables_with
from .cases import COPY, Case, Cases, Plan
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

_KEPT = 4  # robots and controllers that a worker keeps; half: made again more often; twice: memory
GARBAGE = (100_000, 50, 100)  # as of the command line: how seldom to search for it
_ANSWER = 10.0  # [s] for a scheduler to answer; half: a busy one is missed; twice: a longer wait
_AHEAD = 2  # cases for each worker of a given engine; one: workers wait; four: nothing is gained

_IMPORTABLE = (
    "A function must stand at the top of a module that all workers can import, not in a shell, a "
    "notebook or another function."
)


class EngineError(InputError):
    """An engine that cannot run any case."""


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
        tables = tables_with(deepcopy(dict(self.raw)), values, "scenario")
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
        found["worst_after_change"] = extreme(np.max, np.array([each.worst for each in t]))
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


def run_case(work: Work, case: Case, version: str) -> dict[str, Any]:
    """Return the row of a case, whatever happens in it: status, reason, numbers, seconds.

    Raises:
        EngineError: this process has another version of the library than the one that asks.
    """
    if version != __version__:
        raise EngineError(
            f"pinadapt {version} asks, but a worker has pinadapt {__version__}. Install the same "
            "version on all workers."
        )
    started = time.perf_counter()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the row says how the case ended
            found = dict(work(case))
        head = {"status": found.pop("status", DONE), "reason": found.pop("reason", None)}
    except InputError as error:
        head, found = {"status": REFUSED, "reason": str(error)}, {}
    except Exception as error:
        last = traceback.extract_tb(error.__traceback__)[-1]
        place = f"{Path(last.filename).name}:{last.lineno}"
        reason = f"{type(error).__name__}: {error} ({place})"
        head, found = {"status": FAILED, "reason": reason}, {}
    return {**head, **found, "seconds": time.perf_counter() - started}


def _run(packed: bytes, case: Case, version: str) -> dict[str, Any]:
    """Run a case of pickled work.

    Raises:
        EngineError: the work cannot be imported here, or the versions differ.
    """
    return run_case(_unpacked(packed), case, version)


@lru_cache(maxsize=2)
def _unpacked(packed: bytes) -> Work:
    try:
        work: Work = pickle.loads(packed)
    except Exception as error:
        raise EngineError(f"a worker cannot import what is run: {error}. {_IMPORTABLE}") from error
    return work


def _hung(limit: float) -> dict[str, Any]:
    return {"status": TIMEOUT, "reason": f"took longer than {limit:g} s", "seconds": limit}


# --- engines ---


class Here(Executor):
    """An engine that runs every case at once, in this process."""

    def submit(self, function: Any, /, *arguments: Any, **words: Any) -> Future[Any]:
        """Run a function and return its result as a future."""
        future: Future[Any] = Future()
        try:
            future.set_result(function(*arguments, **words))
        except Exception as error:
            future.set_exception(error)
        return future


class Processes(Executor):
    """New processes of this machine, each a pool of one, with a thread that waits for it.

    A process that ends, or that is ended because its case takes too long, costs that case alone and
    is replaced. All of them end with this process, even if it is killed.

    Attributes:
        count: number of processes.
        timeout: [s] after which a case is ended with its process; None: never.
    """

    def __init__(self, count: int | None = None, timeout: float | None = None) -> None:
        """Take the number of processes, by default one for each core that this process may use."""
        self.count, self.timeout = count or cores(), timeout
        self._threads = ThreadPoolExecutor(self.count)
        self._own = threading.local()
        self._running: set[int] = set()
        self._ended = False

    def submit(self, function: Any, /, *arguments: Any, **words: Any) -> Future[Any]:
        """Run a function in the next free process."""
        return self._threads.submit(self._run, function, arguments)

    def _run(self, function: Any, arguments: Any) -> Any:
        """Run a function in the process of this thread."""
        try:
            return self._sent(function, arguments).result(self.timeout)
        except (FutureTimeout, BrokenProcessPool) as error:
            self._kill(self._own.process)
            del self._own.pool
            if isinstance(error, BrokenProcessPool) or self.timeout is None:
                raise
            return _hung(self.timeout)

    def _sent(self, function: Any, arguments: Any) -> Future[Any]:
        """Send a function to the process of this thread; a new one if there is none, or no more.

        Raises:
            EngineError: none can be started.
        """
        with suppress(AttributeError, BrokenProcessPool):
            sent: Future[Any] = self._own.pool.submit(function, *arguments)
            return sent
        self._own.pool = pool = ProcessPoolExecutor(1, get_context("spawn"), _begin)
        try:
            self._own.process = pool.submit(os.getpid).result()  # the clock begins when it runs
        except BrokenProcessPool as error:
            raise EngineError(
                "no process could be started. In a script, the call must be below "
                '`if __name__ == "__main__":`, because every process imports the script.'
            ) from error
        self._running.add(self._own.process)
        if self._ended:
            self._kill(self._own.process)
        return pool.submit(function, *arguments)

    def _kill(self, process: int) -> None:
        self._running.discard(process)
        with suppress(OSError):
            os.kill(process, getattr(signal, "SIGKILL", signal.SIGTERM))

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End all processes at once."""
        self._ended = True
        for process in list(self._running):
            self._kill(process)
        self._threads.shutdown(wait, cancel_futures=True)


def _begin() -> None:
    """Prepare a new process: it ends with its parent, and leaves Ctrl-C to that."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    gc.set_threshold(*GARBAGE)
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
def engine(
    wanted: Executor | int | None, scheduler: str | None = None, timeout: float | None = None
) -> Iterator[Executor]:
    """Yield an engine and end what was started for it.

    Args:
        wanted: an executor, which is left running; a number of processes, 0 for this one; None: one
            process for each core.
        scheduler: address of a Dask scheduler, or "local" for a cluster of this machine.
        timeout: [s] of a case.

    Raises:
        InputError: the scheduler does not answer, or Dask is not installed.
    """
    if isinstance(wanted, Executor):
        yield wanted
    elif scheduler is not None:
        with _dask(scheduler, wanted) as found:
            yield found
    elif wanted == 0:
        yield Here()
    else:
        processes = Processes(wanted, timeout)
        try:
            yield processes
        finally:
            processes.shutdown()


@contextmanager
def _dask(address: str, count: int | None) -> Iterator[Executor]:
    try:
        from distributed import Client
    except ImportError as error:
        raise InputError(
            "Dask is not installed.",
            where="--scheduler",
            hint="Install it: pip install 'pinadapt[dask]'.",
        ) from error
    local = {"n_workers": count or cores(), "threads_per_worker": 1, "dashboard_address": None}
    options = local if address == "local" else {"address": address, "timeout": _ANSWER}
    try:
        client = Client(**options)
    except (OSError, ValueError) as error:
        raise InputError(
            f"the scheduler does not answer within {_ANSWER:g} s: {error}.",
            where=f"--scheduler {address}",
            hint="Start one by `dask scheduler`, and workers by `dask worker ADDRESS "
            "--nthreads 1 --nworkers auto`.",
        ) from error
    with client:
        yield client.get_executor(pure=False)


def _ahead(engine: Executor) -> int:
    """Return how many cases are given to an engine at a time."""
    if isinstance(engine, Here | Processes):
        return getattr(engine, "count", 1)
    client = getattr(engine, "_client", None)
    workers = sum(client.nthreads().values()) if client is not None else 0
    return _AHEAD * (workers or getattr(engine, "_max_workers", cores()))


# --- all cases ---


def rows(work: Work, cases: Iterable[Case], engine: Executor) -> Iterator[dict[str, Any]]:
    """Yield the rows of cases as they end; few cases are in the engine at a time.

    Raises:
        EngineError: the engine cannot run any case.
        InputError: the work cannot be sent to other processes.
    """
    ahead, coming = _ahead(engine), iter(cases)
    running: dict[Future[Any], Case] = {}
    if isinstance(engine, Here):  # nothing is pickled: any function will do
        task: Callable[..., Any] = partial(run_case, work)
    else:
        try:
            packed = pickle.dumps(work)
        except Exception as error:
            raise InputError(
                f"cannot be sent to other processes: {error}.",
                where="function",
                hint=f"{_IMPORTABLE} Or run it in this process: executor=0.",
            ) from error
        task = partial(_run, packed)
    with threadpool_limits(1, "blas"):
        try:
            while True:
                while len(running) < ahead and (case := next(coming, None)) is not None:
                    running[engine.submit(task, case, __version__)] = case
                if not running:
                    return
                done, _ = wait(running, return_when=FIRST_COMPLETED)
                for future in done:
                    yield _row(running.pop(future), future)
        finally:
            for future in running:
                future.cancel()


def _row(case: Case, future: Future[Any]) -> dict[str, Any]:
    """Return the row of a case that has ended: parameters first, then what came of them."""
    error = CancelledError() if future.cancelled() else future.exception()
    if isinstance(error, EngineError) or not isinstance(error, Exception | None):
        raise error
    if error is None:
        found = future.result()
    else:
        words = "its process ended: killed, out of memory, or a crash of compiled code"
        known = isinstance(error, BrokenProcessPool)
        reason = words if known else f"lost by the engine: {type(error).__name__}: {error}"
        found = {"status": CRASHED, "reason": reason, "seconds": None}
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

    The table is the same to the bit in any order of the cases and on any engine, but for the time
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
        timeout: [s] of a case in a process of its own.
        progress: whether to show a bar; None: if standard error is a terminal.

    Raises:
        InputError: a value or a key is not allowed, or the folder holds another sweep.
        EngineError: no case can run.
    """
    tables: dict[str, Any] = {"samples": samples, "method": method, "repeat": repeat, "seed": seed}
    tables |= {"timeout": timeout, "reduce": reduce}
    if isinstance(cases, Mapping):
        tables["vary"] = dict(cases)
    else:
        tables["case"] = list(Cases.of(cases).listed)
    if callable(work):
        tables["function"] = work
    else:
        path = Path(work)
        tables |= {"scenario": read_toml(path), "folder": str(path.resolve().parent)}
    plan = Plan.of({key: value for key, value in tables.items() if value is not None})
    found = work_of(plan)
    with engine(executor, timeout=plan.timeout) as workers:
        place = None if folder is None else claimed(Path(folder), plan, resume=True)
        return run_plan(plan, found, workers, place, Progress(plan, progress))


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
    other = Plan.load(folder)
    if different := plan.differs(other):
        raise InputError(
            f"holds another sweep; {', '.join(different)} {'is' if len(different) == 1 else 'are'} "
            "different.",
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
    work: Work,
    workers: Executor,
    folder: Path | None = None,
    progress: Progress | None = None,
    *,
    retry: bool = False,
) -> CaseTable:
    """Run the cases of a sweep that have no row yet, and return the table of all.

    Args:
        plan: the sweep.
        work: what it runs.
        workers: the engine.
        folder: that holds the rows; None: memory.
        progress: is given every row.
        retry: whether what crashed, failed or took too long runs again.

    Raises:
        EngineError: no case can run.
        OSError: a row could not be written; those before it are kept.
    """
    if folder is None:
        found = []
        for row in rows(work, plan.cases, workers):
            found.append(row)
            if progress is not None:
                progress.tell(row)
        if progress is not None:
            progress.close()
        return CaseTable.of(found)
    with Store(folder, as_csv=plan.csv) as store:
        if retry:
            store.join(without=AGAIN)
        done = store.done()
        missing = (plan.cases[i] for i in range(len(plan.cases)) if i not in done)
        if progress is not None:
            progress.start(len(done))
        try:
            for row in rows(work, missing, workers):
                store.add(row)
                if progress is not None:
                    progress.tell(row)
        finally:
            if progress is not None:
                progress.close()
        return store.join()


class Progress:
    """A bar with rate and time left, and the worst case so far; silent unless on a terminal."""

    def __init__(self, plan: Plan, shown: bool | None = None) -> None:
        """Take the sweep, and whether to show the bar; None: on a terminal."""
        from tqdm import tqdm

        disable = None if shown is None else not shown
        self._bar = tqdm(
            total=len(plan.cases), desc="sweep", unit="case", disable=disable, leave=False
        )
        self._lost, self._worst = 0, (-np.inf, -1)

    def start(self, done: int = 0) -> None:
        """Count the cases that have a row already."""
        self._bar.update(done)

    def tell(self, row: Mapping[str, Any]) -> None:
        """Count a row."""
        self._lost += row["status"] != DONE
        share = row.get("error_share")
        if isinstance(share, float):
            self._worst = max(self._worst, (share, row["case"]))
        share, case = self._worst
        words = [f"{self._lost} lost"] if self._lost else []
        words += [f"worst {percent(share)} (case {case})"] if case >= 0 else []
        self._bar.set_postfix_str(", ".join(words), refresh=False)
        self._bar.update()

    def close(self) -> None:
        """Remove the bar."""
        self._bar.close()
