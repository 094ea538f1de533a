"""Running the cases of a sweep: on processes of this machine, a cluster, or in this process.

An engine is any ``concurrent.futures.Executor``. The case travels to the worker, which makes the
robot and the controller, keeps them for the next case that has the same, and sends back numbers.
A case that raises, diverges, hangs, or takes its process with it, is a row with its reason.
"""

from __future__ import annotations

import gc
import importlib
import logging
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
from concurrent.futures import (
    FIRST_COMPLETED,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    wait,
)
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from copy import deepcopy
from dataclasses import dataclass
from functools import lru_cache, partial
from inspect import Parameter, signature
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from .._compiled import one_blas_thread
from .._output import check_writable, percent, read_toml
from .._version import __version__
from ..exceptions import InputError
from ..rollout.recording import extreme
from ..rollout.rollout import Rollout
from ..rollout.summary import FOLLOWS
from ..scenario.scenario import Scenario
from ..scenario.schema import tables_with
from .cases import COPY, MANY, Case, Cases, Plan
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

_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
_KEPT = 4  # robots and controllers that a worker keeps
GARBAGE = (100_000, 50, 100)  # as of the command line: how seldom to search for it
_ANSWER = 10.0  # [s] for a scheduler to answer
_ATTEMPTS = 3  # in a row to start a process
_AHEAD = 2  # cases for each worker of a given engine, so that none waits for the next


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
        """Return what the function returns; a number alone is called "result".

        Raises:
            InputError: it returns something else.
        """
        function = resolved(self.function, self.path)
        arguments = signature(function).parameters
        takes_all = any(each.kind is Parameter.VAR_KEYWORD for each in arguments.values())
        seeded = "seed" not in case.values and ("seed" in arguments or takes_all)
        found = function(**case.values, **({"seed": case.seed} if seeded else {}))
        if found is None or isinstance(found, Mapping):
            return found or {}
        if isinstance(found, int | float | str | np.generic | np.ndarray | list | tuple):
            return {"result": found}
        raise InputError(
            f"returned {type(found).__name__}; return numbers by name.", where="function"
        )


def resolved(function: Callable[..., Any] | str, path: str = "") -> Callable[..., Any]:
    """Return a function from its name, "module:name".

    Raises:
        InputError: there is no such module, or it has no such function.
    """
    if not isinstance(function, str):
        return function
    module, _, name = function.partition(":")
    if path and path not in sys.path:
        sys.path.insert(0, path)
    try:
        found = getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError, ValueError) as error:
        raise InputError(
            f"cannot be imported: {error}.",
            where=function,
            hint='Write "module:function"; the module is searched for from the folder of the '
            "sweep file.",
        ) from error
    if not callable(found):
        raise InputError("is not a function.", where=function)
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
_environment = threading.Lock()


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


def run_case(work: Callable[[Case], Mapping[str, Any]], case: Case, version: str) -> dict[str, Any]:
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
        head, found = {"status": FAILED, "reason": _where(error)}, {}
    return {**head, **found, "seconds": time.perf_counter() - started}


def _run(
    work: Callable[[Case], Mapping[str, Any]] | bytes,
    case: Case,
    version: str,
    limit: float | None,
) -> dict[str, Any]:
    """Run a case of work, which may be pickled, within a limit [s] if there is one.

    Raises:
        EngineError: the work cannot be imported here, or the versions differ.
    """
    work = _unpacked(work) if isinstance(work, bytes) else work
    return run_case(work, case, version) if limit is None else _within(limit, work, case, version)


@lru_cache(maxsize=2)
def _unpacked(packed: bytes) -> Callable[[Case], Mapping[str, Any]]:
    try:
        work: Callable[[Case], Mapping[str, Any]] = pickle.loads(packed)
    except Exception as error:
        raise EngineError(f"a worker cannot import what is run: {error}. {_IMPORTABLE}") from error
    return work


def _packed(work: Callable[[Case], Mapping[str, Any]]) -> bytes:
    """Return pickled work, once for all cases.

    Raises:
        InputError: it cannot be pickled.
    """
    try:
        return pickle.dumps(work)
    except Exception as error:
        raise InputError(
            f"cannot be sent to other processes: {error}.",
            where="function",
            hint=f"{_IMPORTABLE} Or run it in this process: executor=0.",
        ) from error


def _where(error: Exception) -> str:
    """Return an error, with the place of the last line of its traceback."""
    last = traceback.extract_tb(error.__traceback__)[-1:]
    place = f" ({Path(last[0].filename).name}:{last[0].lineno})" if last else ""
    return f"{type(error).__name__}: {error}{place}"


def _within(
    limit: float, work: Callable[[Case], Mapping[str, Any]], case: Case, version: str
) -> dict[str, Any]:
    """Run a case in a thread that is left behind after some seconds: no thread can be ended."""
    found: Future[dict[str, Any]] = Future()

    def target() -> None:
        """Run the case and hand over its row, or what it raised."""
        try:
            found.set_result(run_case(work, case, version))
        except BaseException as error:
            found.set_exception(error)

    threading.Thread(target=target, daemon=True).start()
    done, _ = wait([found], timeout=limit)
    if not done:
        return _hung(limit)
    return found.result()


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
    """New processes of this machine, each a pool of its own.

    A process that ends, or that is ended because its case takes too long, costs that case alone and
    is replaced. All of them end with this process, even if it is killed.

    Attributes:
        count: number of processes.
        timeout: [s] after which a case is ended with its process; None: never.
    """

    def __init__(self, count: int | None = None, timeout: float | None = None) -> None:
        """Take the number of processes, by default one for each core that this process may use."""
        self.count, self.timeout = count or cores(), timeout
        self._lock = threading.RLock()
        self._waiting: deque[tuple[Future[Any], Callable[[], Any], tuple[Any, ...]]] = deque()
        self._idle: list[_Process] = []
        self._all: list[_Process] = []
        self._ended, self._failed = False, 0
        self.broken: str | None = None
        context = get_context("spawn")
        self._listen, self._alive = context.Pipe(duplex=False)
        for _ in range(self.count):
            self._add()

    def submit(self, function: Any, /, *arguments: Any, **words: Any) -> Future[Any]:
        """Run a function in the next free process."""
        future: Future[Any] = Future()
        with self._lock:
            if self._ended:
                raise RuntimeError("the engine was shut down.")
            self._waiting.append((future, function, arguments))
        self._next()
        return future

    def _add(self) -> None:
        process = _Process(self._listen, self._ready)
        with self._lock:
            self._all.append(process)
        process.start()

    def _replace(self, process: _Process) -> None:
        with self._lock:
            self._all.remove(process)
        process.end()
        self._add()

    def _ready(self, process: _Process, started: bool) -> None:
        """Give a process its first case once it has started, or give up if it cannot start."""
        if started:
            with self._lock:
                self._idle.append(process)
                self._failed = 0
            self._next()
            return
        with self._lock:
            self._failed += 1
            again = self._failed <= _ATTEMPTS and not self._ended
        if again:
            self._replace(process)
            return
        with self._lock:
            self.broken = (
                "no process could be started. In a script, the call must be below "
                '`if __name__ == "__main__":`, because every process imports the script.'
            )
            waiting, self._waiting = list(self._waiting), deque()
        if not self._ended:
            for future, _, _ in waiting:
                future.set_exception(EngineError(self.broken))

    def _next(self) -> None:
        while True:
            with self._lock:
                if self.broken is not None and self._waiting:
                    self._waiting.popleft()[0].set_exception(EngineError(self.broken))
                    continue
                if self._ended or not (self._waiting and self._idle):
                    return
                future, function, arguments = self._waiting.popleft()
                if not future.running() and not future.set_running_or_notify_cancel():
                    continue
                process = self._idle.pop()
            inner = process.run(function, arguments, self.timeout)
            if inner is None:  # it was ended while it had nothing to do
                process.rest()
                with self._lock:
                    self._waiting.appendleft((future, function, arguments))
                self._replace(process)
                continue
            inner.add_done_callback(partial(self._done, process, future))

    def _done(self, process: _Process, future: Future[Any], inner: Future[Any]) -> None:
        """Hand on a result; a process that has ended is replaced."""
        hung = process.rest()
        error = CancelledError() if inner.cancelled() else inner.exception()
        if self._ended:
            future.cancel()
            return
        if hung or isinstance(error, BrokenProcessPool):
            self._replace(process)
        else:
            with self._lock:
                self._idle.append(process)
            self._next()
        if hung and error is not None and self.timeout is not None:
            future.set_result(_hung(self.timeout))
            return
        if error is None:
            future.set_result(inner.result())
        else:
            future.set_exception(error)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End all processes at once."""
        with self._lock:
            self._ended, all_ = True, list(self._all)
        self._alive.close()
        for process in all_:
            process.end()
        self._listen.close()


class _Process:
    """One process: a pool of one, its process id, and the clock of its present case."""

    def __init__(self, listen: Connection, ready: Callable[[_Process, bool], None]) -> None:
        self._pool = ProcessPoolExecutor(1, get_context("spawn"), _begin, (listen,))
        self._told, self._pid, self._hung = ready, 0, False
        self._lock = threading.Lock()
        self._clock: threading.Timer | None = None
        self._case: Future[Any] | None = None

    def start(self) -> None:
        """Start the process of the pool, before there is a case for it."""
        with _one_thread_each(), _deaf():
            future = self._pool.submit(os.getpid)
        future.add_done_callback(self._started)

    def _started(self, future: Future[int]) -> None:
        if future.cancelled() or future.exception() is not None:
            self._told(self, False)
            return
        self._pid = future.result()
        self._told(self, True)

    def run(self, function: Any, arguments: Any, timeout: float | None) -> Future[Any] | None:
        """Run a function; None if the process has ended while it had nothing to do."""
        self._hung = False
        try:
            future = self._pool.submit(function, *arguments)
        except BrokenProcessPool:
            return None
        if timeout is not None:
            with self._lock:
                self._clock = threading.Timer(timeout, self._end_case, (future,))
                self._clock.daemon = True
                self._case = future
                self._clock.start()
        return future

    def rest(self) -> bool:
        """Stop the clock; return whether it has ended the case, and the process."""
        with self._lock:
            self._case = None
            if self._clock is not None:
                self._clock.cancel()
                self._clock = None
        return self._hung

    def _end_case(self, case: Future[Any]) -> None:
        with self._lock:
            if self._case is case and not case.done():
                self._hung = True
                self._kill()

    def _kill(self) -> None:
        with suppress(OSError):
            if self._pid:
                os.kill(self._pid, getattr(signal, "SIGKILL", signal.SIGTERM))

    def end(self) -> None:
        """Kill the process and give up its pool."""
        self._kill()
        self._pid = 0
        self._pool.shutdown(wait=False, cancel_futures=True)


def _begin(listen: Connection) -> None:
    """Prepare a new process: it ends with its parent, and has what every run needs.

    Its first case then takes no longer than the others, which a time limit has to know.
    """
    gc.set_threshold(*GARBAGE)
    threading.Thread(target=_end_with, args=(listen,), daemon=True).start()


def _end_with(pipe: Connection) -> None:
    """End this process when the other end of a pipe closes."""
    try:
        pipe.recv_bytes()
    except (EOFError, OSError):
        os._exit(1)


@contextmanager
def _deaf() -> Iterator[None]:
    """Let processes that are started inside ignore Ctrl-C; this process receives it afterwards."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Let processes that are started inside use one thread for linear algebra."""
    with _environment:
        before = {name: os.environ.get(name) for name in _THREADS}
        os.environ.update(dict.fromkeys(_THREADS, "1"))
        try:
            yield
        finally:
            for name, value in before.items():
                if value is None:
                    del os.environ[name]
                else:
                    os.environ[name] = value


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
        from distributed import Client, LocalCluster
    except ImportError as error:
        raise InputError(
            "Dask is not installed.",
            where="--scheduler",
            hint="Install it: pip install 'pinadapt[dask]'.",
        ) from error
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of ports that are taken
        if address == "local":
            with (
                LocalCluster(
                    n_workers=count or cores(),
                    threads_per_worker=1,
                    dashboard_address=None,
                    silence_logs=logging.ERROR,  # not of workers that end slowly
                ) as cluster,
                Client(cluster) as client,
            ):
                yield client.get_executor(pure=False)
            return
        try:
            client = Client(address, timeout=_ANSWER)
        except (OSError, ValueError) as error:
            raise InputError(
                f"the scheduler does not answer within {_ANSWER:g} s: {error}.",
                where=f"--scheduler {address}",
                hint="Start one by `dask scheduler`, and workers by `dask worker ADDRESS "
                "--nthreads 1 --nworkers auto`.",
            ) from error
        with client:
            if not client.nthreads():
                raise InputError(
                    "the scheduler has no worker.",
                    where=f"--scheduler {address}",
                    hint=f"Start some: `dask worker {address} --nthreads 1 --nworkers auto`.",
                )
            yield client.get_executor(pure=False)


def _workers(engine: Executor) -> int:
    """Return how many cases an engine runs at a time, as far as it says so."""
    client = getattr(engine, "_client", None)
    if client is not None and hasattr(client, "nthreads"):
        return max(1, sum(client.nthreads().values()))
    return int(getattr(engine, "_max_workers", 0) or cores())


# --- all cases ---


def rows(
    work: Callable[[Case], Mapping[str, Any]],
    cases: Iterable[Case],
    engine: Executor,
    timeout: float | None = None,
) -> Iterator[dict[str, Any]]:
    """Yield the rows of cases as they end; few cases are in the engine at a time.

    Raises:
        EngineError: the engine cannot run any case.
    """
    own = isinstance(engine, Processes)
    ahead = engine.count if isinstance(engine, Processes) else _AHEAD * _workers(engine)
    ahead = 1 if isinstance(engine, Here) else ahead
    running: dict[Future[Any], Case] = {}
    coming = iter(cases)
    limit = None if own else timeout
    # in one process nothing is pickled, so that there any function will do
    shared = isinstance(engine, Here | ThreadPoolExecutor)
    task = partial(_run, work if shared else _packed(work), limit=limit)
    with one_blas_thread():
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
    if isinstance(error, EngineError):
        raise error
    if isinstance(error, ImportError | AttributeError):
        raise EngineError(
            f"a worker cannot import what is run: {error}. Install pinadapt {__version__}, and the "
            "module of the function, on all workers."
        ) from error
    if error is None:
        found = future.result()
    elif isinstance(error, Exception):
        words = "its process ended: killed, out of memory, or a crash of compiled code"
        known = isinstance(error, BrokenProcessPool)
        reason = words if known else f"lost by the engine: {type(error).__name__}: {error}"
        found = {"status": CRASHED, "reason": reason, "seconds": None}
    else:
        raise error
    head = {"status": found["status"], "reason": found["reason"]}
    results = {
        f"{key} (result)" if key in case.values or key in ("case", "seed") else key: value
        for key, value in found.items()
        if key not in head and not (key in case.values and case.values[key] == value)
    }
    return {"case": case.number, "seed": case.seed, **case.values, **head, **results}


# --- the whole sweep ---


def work_of(plan: Plan) -> ScenarioWork | FunctionWork:
    """Return what a sweep runs for each case.

    Raises:
        InputError: a function cannot be imported.
    """
    for function in (plan.function, plan.reduce):
        if isinstance(function, str):
            resolved(function, plan.path)
    if plan.function is not None:
        return FunctionWork(plan.function, plan.path)
    assert plan.raw is not None
    return ScenarioWork(plan.raw, plan.folder, plan.reduce, plan.path)


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
        timeout: [s] of a case.
        progress: whether to show a bar; None: if standard error is a terminal.

    Raises:
        InputError: a value or a key is not allowed, there are more than a million cases, or the
            folder holds another sweep.
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
    if len(plan.cases) > MANY:
        raise InputError(f"{len(plan.cases):,} cases are more than {MANY:,}.", where="cases")
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
    work: Callable[[Case], Mapping[str, Any]],
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
        for row in rows(work, plan.cases, workers, plan.timeout):
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
        missing = (
            case for i in range(len(plan.cases)) if i not in done for case in [plan.cases[i]]
        )
        if progress is not None:
            progress.start(len(done))
        try:
            for row in rows(work, missing, workers, plan.timeout):
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
        self._total, self._shown = len(plan.cases), shown
        self._lost, self._worst, self._case = 0, -np.inf, -1
        self._bar: Any = None

    def start(self, done: int = 0) -> None:
        """Show the bar, with the cases that have a row already."""
        from tqdm import tqdm

        disable = None if self._shown is None else not self._shown
        self._bar = tqdm(
            total=self._total, initial=done, desc="sweep", unit="case", disable=disable, leave=False
        )

    def tell(self, row: Mapping[str, Any]) -> None:
        """Count a row."""
        if self._bar is None:
            self.start()
        share = row.get("error_share")
        if row["status"] != DONE:
            self._lost += 1
        elif isinstance(share, int | float) and share > self._worst:
            self._worst, self._case = float(share), row["case"]
        words = [f"{self._lost} lost"] if self._lost else []
        if self._case >= 0:
            words.append(f"worst {percent(self._worst)} (case {self._case})")
        self._bar.set_postfix_str(", ".join(words), refresh=False)
        self._bar.update()

    def close(self) -> None:
        """Remove the bar."""
        if self._bar is not None:
            self._bar.close()
