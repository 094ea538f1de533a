"""One loop that runs a controller on an ``Arm`` at its rate, and always ends in damped rest.

    starting -> running -> holding -> damping -> stopped

*Running* is the stage itself: torques computed and not sent, gravity compensation, a hold,
a slow motion, or the motion with adaptation. *Holding*: the time of the path comes to rest within
0.3 s, the estimates rest. *Damping*: gravity compensation and -D v until the joints rest.
*Stopped*: the arm's own stop. The checklist of ``safety`` says which of the last three a finding
leads to.
"""

from __future__ import annotations

import ctypes
import gc
import math
import os
import signal
import sys
import threading
import time
from array import array
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from enum import Enum, IntEnum
from types import FrameType
from typing import Any

import numpy as np
import pinocchio as pin
from threadpoolctl import threadpool_limits

from .._checks import instance, positive, vector
from .._output import Sheet, Table
from ..controller.controller import Controller
from ..controller.state import ControllerState
from ..exceptions import ArmError, InputError, PinadaptError
from ..records import Desired, Measurement
from ..reference import starting_from
from ..trajectories.given import TrajectoryLike, as_trajectory
from ..trajectories.trajectory import Hold, Retimed, SlowedTime, SmoothStart, TimeLaw, Trajectory
from .arm import Arm, as_measured
from .recorder import Recorder, load_of
from .safety import Answer, Checklist, Safety, SafetyFinding

_WARM_UPS = 60  # steps before the first cycle, by which all kernels have run
_ASIDE = 2e-3  # [m or rad] that they aim beside the arm, as estimates rest where nothing is off
_HALT, _HOLD = 0.3, 0.5  # [s] until the path rests, and until the arm is damped
_SWINGS = 0.2  # [rad/s or m/s] of an arm that is not coming to rest by damping
_DAMP, _STILL, _QUIET = 1.5, 0.02, 50  # [s] longest, [rad/s or m/s], cycles below it
_RINGING = 2.0  # [s] of the end of a run that are searched for ringing
_CALM = 0.5  # [s] without a finding after which the adaptation goes on
_FREE = 0.5  # [1/s] damping of a free drive
_PATIENCE = 2.0  # [s] for the first frame of a camera
_RESERVE, _APART = 32_000, 500  # blocks of half a kilobyte, and each how many of them stay
_ALIVE = 256  # cycles between two looks at the process of the log
_AHEAD = 2.5  # times the last step, before the next one is due, at which that is rehearsed
_AWAKE = 2e-5  # [s] before a measurement is due until which the core does not rest
_DRIFT = 2e-3  # of a period, by which the beat of an arm may come later in each of its cycles
_BRIEF, _PACE = 0.25, 0.9  # shares of a period: longest step, and shortest wait, to rehearse


class Stage(Enum):
    """What the loop does, in the order in which an arm should be brought into operation."""

    LOG = "log"  # torques are computed and logged; nothing is sent
    GRAVITY = "gravity"  # gravity compensation, to be moved by hand
    HOLD = "hold"  # the place where the arm is
    SLOW = "slow"  # the motion, slowly, without adaptation
    ADAPT = "adapt"  # the motion with adaptation


class Phase(IntEnum):
    """Phases of the loop, in their order; only a commanded hold returns to running."""

    STARTING, RUNNING, HOLDING, DAMPING, STOPPED = range(5)


@dataclass(frozen=True)
class Scheduling:
    """Real-time settings requested of the operating system; those denied are noted.

    Attributes:
        priority: real-time priority (SCHED_FIFO), 1 to 99; None: that of any program.
        core: processor core to stay on; None: any.
        lock: whether all memory is kept from being paged out.
        rehearse: warm-up: whether the coming step is computed once while the loop waits, and its
            result discarded. After an idle millisecond a step takes up to twice as long.
    """

    priority: int | None = 80
    core: int | None = None
    lock: bool = True
    rehearse: bool = True

    @contextmanager
    def applied(self) -> Iterator[list[str]]:
        """Apply it, yield notes on what is not allowed, and take it back."""
        notes: list[str] = []
        before: list[Callable[[], object]] = []
        if self.priority is not None:
            try:
                policy, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
                os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(self.priority))
                before.append(lambda: os.sched_setscheduler(0, policy, parameters))
            except (OSError, AttributeError) as error:
                notes.append(
                    f"no real-time priority ({error}): other programs will make cycles late; add "
                    "'@realtime - rtprio 99' to /etc/security/limits.conf and yourself to the group"
                )
        if self.core is not None:
            try:
                cores = os.sched_getaffinity(0)
                os.sched_setaffinity(0, {self.core})
                before.append(lambda: os.sched_setaffinity(0, cores))
            except (OSError, AttributeError, ValueError) as error:
                notes.append(f"not pinned to core {self.core}: {error}")
        if self.lock:
            problem = _lock_memory()
            if problem:
                notes.append(
                    f"memory is not locked ({problem}): paging may make cycles late; raise "
                    "'memlock' in /etc/security/limits.conf"
                )
            else:
                kept = _reserved()
                before += [kept.clear, lambda: ctypes.CDLL(None).munlockall()]
        try:
            yield notes
        finally:
            for back in reversed(before):
                with suppress(OSError):
                    back()


def _lock_memory() -> str:
    """Keep the memory of this process from being paged out; return what prevents it."""
    if not sys.platform.startswith("linux"):
        return f"not available on {sys.platform}"
    with suppress(OSError, AttributeError):
        if ctypes.CDLL(None, use_errno=True).mlockall(3) == 0:  # current and future
            return ""
        return os.strerror(ctypes.get_errno())
    return "no mlockall"


def _reserved() -> list[bytes]:
    """Return blocks that keep some megabytes of Python's memory from going back to the system.

    New memory is locked page by page, which takes a millisecond for each megabyte.
    """
    blocks = [bytes(480) for _ in range(_RESERVE)]
    return blocks[::_APART]


class Histogram:
    """Histogram of times in bins of a microsecond; those above 100 ms share one bin."""

    def __init__(self) -> None:
        """Begin without times."""
        self._counts = array("Q", bytes(8 * 100_001))
        self.count, self.worst = 0, 0.0

    def add(self, seconds: float) -> None:
        """Count a time [s]."""
        self._counts[min(max(int(1e6 * seconds), 0), 100_000)] += 1
        self.count += 1
        if seconds > self.worst:
            self.worst = seconds

    def share(self, share: float) -> float:
        """Return the time [s] below which a share of all lies; NaN if there is none."""
        if not self.count:
            return math.nan
        below = np.cumsum(np.frombuffer(self._counts, dtype=np.uint64))
        return float(np.searchsorted(below, math.ceil(share * self.count))) * 1e-6

    def above(self, seconds: float) -> int:
        """Return how many times are longer [s]."""
        counts = np.frombuffer(self._counts, dtype=np.uint64)
        return int(counts[int(1e6 * seconds) :].sum())

    def row(self) -> list[str]:
        """Return median, 99 %, 99.9 % and worst in microseconds."""
        shares = [f"{1e6 * self.share(share):.0f}" for share in (0.5, 0.99, 0.999)]
        return [*shares, f"{1e6 * self.worst:.0f}"] if self.count else ["-"] * 4


@dataclass
class Ending:
    """How a run of the loop ended; ``print`` shows a table.

    Attributes:
        reason: why it ended.
        phases: time [s] since the start, phase, and why it was entered.
        cycles: how many there were.
        late: how many took more than one and a half periods, by either clock.
        step: time from a measurement to its torque [s].
        period: time between measurements by this computer's clock [s].
        arm_period: the same by the time of the measurements [s].
        received: least share of its last torques that the arm has received; NaN: not reported.
        notes: what the system did not allow, and what else was noticed.
        state: the last state of the controller; None if it never began.
        failed: whether anything but a command or the end of the time ended it.
    """

    reason: str = ""
    phases: list[tuple[float, str, str]] = field(default_factory=list)
    cycles: int = 0
    late: int = 0
    step: Histogram = field(default_factory=Histogram)
    period: Histogram = field(default_factory=Histogram)
    arm_period: Histogram = field(default_factory=Histogram)
    received: float = math.nan
    notes: list[str] = field(default_factory=list)
    state: ControllerState | None = None
    failed: bool = False

    def __str__(self) -> str:
        """Return the histogram, the phases and the notes."""
        parts = {
            "step": self.step, "period, here": self.period, "period, arm": self.arm_period,
        }  # fmt: skip
        times = Table(
            [(name, *part.row()) for name, part in parts.items()],
            ("[us]", "median", "99 %", "99.9 %", "worst"),
        )
        rows = [("cycles", str(self.cycles)), ("late", f"{self.late} by over half a period")]
        if self.received == self.received:
            rows.append(("received", f"at least {self.received:.0%} of the last torques"))
        rows += [(phase, f"{t:8.3f} s  {why}") for t, phase, why in self.phases]
        rows += [("note", note) for note in self.notes]
        return str(Sheet(f"loop, {self.reason}", [times, Table(rows)]))


class _Halted(TimeLaw):
    """s = t up to an instant, then its rate falls to zero within a while; or, resumed, rises."""

    def __init__(self, begin: float, *, place: float | None = None) -> None:
        """Take the instant [s], and where the path rests until then if it is to go on [s]."""
        self._begin, self._place, self._start = begin, place, SmoothStart(_HALT)

    def at(self, t: float) -> tuple[float, float, float]:
        """Return s [s], ds/dt and d^2s/dt^2 [1/s] at time t [s]."""
        s, rate, acceleration = self._start.at(t - self._begin)
        if self._place is not None:
            return self._place + s, rate, acceleration
        if t <= self._begin:
            return t, 1.0, 0.0
        return t - s, 1.0 - rate, -acceleration

    def when(self, s: float) -> float:
        """Return the time t [s] at which the path's time would be s [s], moving."""
        return self._begin + s - self.at(self._begin)[0]

    def repeats(self, since: float, period: float) -> tuple[float, float] | None:
        """Return None: it does not repeat."""
        return None


class RealtimeLoop:
    """A controller on an arm, cycle by cycle, until the time is over or it is stopped.

    Use it inside of the ``with`` statements of the arm and of the recorder, if there is one.

    Attributes:
        stage: what it does.
        safety: numbers of the checklist.
        ending: what has happened so far; ``run`` returns it.
    """

    def __init__(
        self,
        arm: Arm,
        controller: Controller,
        motion: TrajectoryLike | None = None,
        *,
        stage: Stage | str = Stage.LOG,
        safety: Safety | None = None,
        recorder: Recorder | None = None,
        start: Mapping[str, Any] | None = None,
        slowness: float = 5.0,
        scheduling: Scheduling | None = None,
        say: Callable[[str], None] | None = None,
    ) -> None:
        """Take arm and controller and check that they fit.

        Args:
            arm: to be driven.
            controller: made for its joints, its period and what it compensates.
            motion: of the task, from where the arm is or after an approach; None: it holds.
            stage: what to do.
            safety: numbers of the checklist; None for the defaults.
            recorder: writes the log and answers other programs; None for neither.
            start: initial estimates ``a_k`` and ``a_d``, ``information`` and ``information_k``, as
                of ``simulate``. Where the axes of x are unknown, and ``a_k`` is not given, the arm
                first holds its joints and moves by millimetres, see ``SlowStart``.
            slowness: by which a slow motion is slower.
            scheduling: what is asked of the system; None for the defaults.
            say: gets each message; None prints it to standard error.

        Raises:
            InputError: they do not fit.
        """
        self._arm, self._controller = instance(arm, Arm, "arm"), controller
        instance(controller, Controller, "controller")
        self.stage = _stage(stage)
        self._facts = facts = arm.facts
        _check_fit(arm, controller)
        kinematics = controller.kinematics
        known = kinematics.calibrated or (start or {}).get("a_k") is not None
        if self.stage is Stage.SLOW and motion is not None and not known:
            raise InputError(
                "without adaptation the axes of x remain unknown.",
                where="stage",
                hint='Take "adapt", which first finds them by millimetres of motion; or give '
                "start=found.start of what information.find_tracker returns.",
            )
        self._motion = None if motion is None else as_trajectory(motion, kinematics.task)
        self.safety = Safety() if safety is None else safety
        self._checks = Checklist(self.safety, controller, facts)
        self._recorder, self._start = recorder, dict(start or {})
        self._slowness = positive(slowness, "slowness")
        self._scheduling = Scheduling() if scheduling is None else scheduling
        self._say = say if say is not None else _print
        n = kinematics.robot.model.nv
        self._zero, self._still = np.zeros(n), np.zeros(kinematics.task.size)
        self._sizes = {"q": kinematics.nq, **dict.fromkeys(("v", "a", "tau", "w"), n)}
        if kinematics.positions:  # a joint task ignores x
            self._sizes |= {"x": kinematics.task.coordinates, "xd": kinematics.task.size}
        self._flaw = ""
        self._sent = np.zeros(n)
        self._given: np.ndarray | None = None
        self._before: np.ndarray | None = None
        self._state: ControllerState | None = None
        self._path: Trajectory | None = None
        self._begin = self._t = 0.0
        self._phase, self._since, self._calm = Phase.STARTING, 0, 0
        self._adapting = self.stage is Stage.ADAPT
        self._resting, self._halted, self._quiet = False, False, 0
        self._frame: tuple[np.ndarray, float] | None = None
        self._signals, self._age, self._first = 0, 0.0, 0.0
        self._sought: deque[tuple[np.ndarray, ...]] = deque(maxlen=round(_RINGING / facts.period))
        self._asked: np.ndarray | None = None
        self._goal: Desired | None = None
        self.ending = Ending()

    # --- a run ----------------------------------------------------------------------------------

    def run(self, duration: float | None = None) -> Ending:
        """Run until ``duration`` [s] is over, a command or a finding ends it; None: no end.

        The arm is stopped whatever happens.

        Raises:
            InputError: the arm is where the controller cannot start.
            ArmError: the arm refuses to begin, its first measurements cannot be used, or another
                loop drives it.
        """
        recorder, collecting = self._recorder, gc.isenabled()
        scheduled = self._scheduling.applied()
        with (
            self._alone(),
            self._signals_caught(),
            threadpool_limits(1, "blas"),
            scheduled as notes,
        ):
            self.ending.notes += notes
            for note in notes:
                self._say(note)
            try:
                m = self._prepared()
                self._cycles(m, duration)
            except ArmError as error:
                if self._phase is Phase.STARTING:
                    self._enter(Phase.STOPPED, str(error), failed=True)
                    raise
                self._enter(Phase.STOPPED, str(error), failed=True)
            except BaseException as error:
                self._enter(Phase.STOPPED, f"{type(error).__name__}: {error}", failed=True)
                raise
            finally:
                if collecting:
                    gc.enable()
                self._arm.stop(self.ending.reason or "the loop has ended")
                self.ending.state = self._state
                self.ending.notes += self._ringing()
                if recorder is not None and recorder.trouble:
                    self.ending.notes.append(recorder.trouble)
        return self.ending

    @contextmanager
    def _alone(self) -> Iterator[None]:
        """Keep other loops from driving the arm.

        Raises:
            ArmError: one does.
        """
        lock = vars(self._arm).setdefault("_driven", threading.Lock())
        if not lock.acquire(blocking=False):
            raise ArmError(
                "is driven by another loop.",
                where=self._facts.name,
                hint="Let that end first, and use one loop for one arm.",
            )
        try:
            yield
        finally:
            lock.release()

    def _prepared(self) -> Measurement:
        """Return the first measurement, with all code run and all memory touched before."""
        arm, controller = self._arm, self._controller
        self._about()
        first = m = self._first_frame()
        state = controller.init(m, **self._start)
        motion: Trajectory = Hold(controller.kinematics.task.measured(m.x, m.q))
        if self._motion is not None and self.stage in (Stage.LOG, Stage.SLOW, Stage.ADAPT):
            believed = controller.kinematics.seen(state.a_k)
            motion = starting_from(self._motion, believed, m)
            if self.stage is Stage.SLOW:
                motion = Retimed(motion, SlowedTime(self._slowness))
        self._path, self._begin, self._t = motion, m.t, m.t
        desired = motion.at(0.0)
        if desired.x_d.size == desired.xd_d.size:  # no quaternion
            desired = desired._replace(x_d=desired.x_d + _ASIDE)
        self._warmed(state, m, desired)
        if state.start is not None:  # what follows it as well
            known = {**self._start, "a_k": state.a_k}
            self._warmed(controller.init(m, **known), m, desired)
        self._checks = Checklist(self.safety, controller, self._facts)
        if controller.disturbance(state) is None:
            self._note("contact is not detected: law and adaptation observe no disturbance")
        gc.collect()
        gc.disable()
        arm.read()
        if self.stage is not Stage.LOG:
            arm.begin()
        m = self._read_first()
        if m.x is None:
            m = m._replace(x=first.x)  # the arm rests, so an old frame is still valid
        self._begin = self._t = m.t
        self._state = controller.init(m, **self._start).adapt(self._adapting)
        # what holds the arm as the brakes have held it
        self._sent, _ = controller.safe(self._state, m, damping=0.0)
        self._enter(Phase.RUNNING, f"stage '{self.stage.value}'")
        return m

    def _warmed(self, state: ControllerState, m: Measurement, desired: Desired) -> None:
        """Run all code of a cycle from a state, with a measurement and a reference."""
        warm, controller = state.adapt(self._adapting), self._controller
        tau = m.tau  # the brakes hold the arm: what is measured now is not what is asked for
        for k in range(_WARM_UPS):
            sample = m._replace(t=m.t + k * self._facts.period, tau=tau)
            torque, warm = controller.step(warm, sample, desired, self._facts.period)
            if tau is not None:
                added = controller.compensation
                tau = torque if added is None else torque + added(m.q)
            self._checks.limited(torque, self._zero, self._facts.period)
            self._checks.of_arm(sample, self._facts.period)
            self._watched(sample, self._facts.period, warm, desired, torque)
            controller.safe(warm, sample, damping=self.safety.damping)

    def _first_frame(self) -> Measurement:
        """Return the first measurement with a frame of the camera, if the task needs one.

        Raises:
            ArmError: none comes.
        """
        needed = bool(self._controller.kinematics.positions)
        for _ in range(round(_PATIENCE / self._facts.period)):
            m = self._read_first()
            self._t = m.t
            self._heed_commands(m)
            m = self._with_frame(m)
            if m.x is not None or not needed:
                return m
            if not self._facts.paced:
                time.sleep(self._facts.period)
        raise ArmError(
            f"no position of the task frame came for {_PATIENCE:g} s.",
            where=self._facts.name,
            hint="Does the camera run? Without one take a joint task.",
        )

    def _with_frame(self, m: Measurement) -> Measurement:
        """Return a measurement with the frame that another process has sent, if there is one."""
        if self._frame is None or m.x is not None:
            return m
        (x, x_time), self._frame = self._frame, None
        return m._replace(x=x, x_time=x_time)

    def _about(self) -> None:
        """Log what a replay needs."""
        if self._recorder is not None:
            start = {
                key: None if value is None else np.asarray(value).tolist()
                for key, value in self._start.items()
            }
            self._recorder.event(
                begun={"stage": self.stage.value, "start": start, "period": self._facts.period}
            )

    def _cycles(self, m: Measurement, duration: float | None) -> None:
        """Run the cycles from the first measurement on."""
        arm, ending, period = self._arm, self.ending, self._facts.period
        clock = time.perf_counter
        due = arrived = self._first = clock()
        late, drift, pace = 1.5 * period, _DRIFT * period, 0.0
        paced, rehearse = self._facts.paced, self._scheduling.rehearse
        in_time = self._facts.clock != "simulated"
        host = dt = 0.0
        while True:
            began = clock()
            self._t = m.t
            torque = self._cycle(m, dt, host)
            if torque is not None:
                arm.send(torque.copy())
            spent = clock() - began
            ending.step.add(spent)
            ending.cycles += 1
            if self._recorder is not None:
                self._record(m, dt, spent, began)
            if self._phase is Phase.STOPPED:
                return
            if duration is not None and m.t - self._begin >= duration and not self._leaving:
                self._enter(Phase.HOLDING, "the time is over")
            due += period
            if rehearse and spent < _BRIEF * period and pace > _PACE * period:
                self._rehearse(m, due, min(_AHEAD * spent, 0.5 * period))
            if not paced:
                left = due - clock()
                if left > 0.0:
                    time.sleep(left)
                elif left < -period:
                    due = clock()  # missed deadlines are not made up for
            m = self._read()
            before, arrived = arrived, clock()
            pace, dt = arrived - before, m.t - self._t
            host = pace if in_time else 0.0
            ending.period.add(pace)
            ending.arm_period.add(dt)
            ending.received = float(np.fmin(arm.received, ending.received))
            if paced:  # the arm's beat, by its earliest measurements
                due = arrived if arrived > due + 0.5 * period else min(arrived, due + drift)
            if max(dt, host) > late:
                ending.late += 1

    def _rehearse(self, m: Measurement, due: float, ahead: float) -> None:
        """Compute the step after m, ahead of the time at which it is due [s], and stay awake.

        The core then has all it needs at hand. ``Controller.step`` is pure: the step to come does
        not notice.
        """
        clock = time.perf_counter
        left, state = due - ahead - clock(), self._state
        if left < 0.0 or self._asked is None or state is None or self._path is None:
            return
        time.sleep(left)
        controller, period = self._controller, self._facts.period
        q = pin.integrate(controller.kinematics.robot.model, m.q, period * m.v)
        seen = None if m.x_time is None else m.x_time + period
        m = m._replace(t=m.t + period, q=q, x_time=seen)
        with suppress(PinadaptError):
            desired = controller.desired(state, self._path, m.t - self._begin)
            controller.step(state, m, desired, period)
        while clock() < due - _AWAKE:
            pass

    def _read(self) -> Measurement:
        """Return the next measurement; ``_flaw`` says what is wrong with it."""
        m, self._flaw = as_measured(self._arm.read(), self._sizes, self._t + self._facts.period)
        return m

    def _read_first(self) -> Measurement:
        """Return a measurement before anything moves.

        Raises:
            ArmError: there is something wrong with it.
        """
        m = self._read()
        if self._flaw:
            raise ArmError(f"{self._flaw}.", where=self._facts.name)
        return m

    def _cycle(self, m: Measurement, dt: float, host: float) -> np.ndarray | None:
        """Return the torque (n) to send now, or None in log-only mode and after the end."""
        self._asked, self._goal, self._before = None, None, self._given
        self._heed_commands(m)
        self._measured = m = self._with_frame(m)
        finding = self._checks.of_arm(m, dt, host, self._arm.received)
        if self._flaw:
            finding = SafetyFinding("driver", self._flaw, Answer.DAMP)
        if self._recorder is not None and finding is None:
            finding = self._log_trouble()
        if self._signals:
            finding = self._interrupted() or finding
        if finding is not None:
            self._answer(finding)
        if self._phase is Phase.STOPPED:
            return None
        torque: np.ndarray | None = None
        if self._phase is Phase.RUNNING and self.stage is Stage.GRAVITY:
            torque = self._safe(m, _FREE, hold=False)
        elif self._phase in (Phase.RUNNING, Phase.HOLDING):
            torque = self._controlled(m, dt)
        if self._phase is Phase.DAMPING:
            torque = self._safe(m, self.safety.damping)
            torque += self._checks.unexplained  # of a load that is not learned: it does not sink
            self._until_rest()
        if self._phase is Phase.HOLDING and not self._halted:
            self._quiet += 1
            if self._quiet * self._facts.period > _HOLD:
                self._enter(Phase.DAMPING, "the path rests")
        if self._phase is Phase.STOPPED or torque is None or self.stage is Stage.LOG:
            return None
        if not np.isfinite(torque).all():
            self._answer(SafetyFinding("controller", "a torque is not finite", Answer.STOP))
            return None
        safe, _ = self._checks.limited(torque, self._sent, max(dt, self._facts.period))
        self._sent = safe
        added = self._controller.compensation
        self._given = safe if added is None else safe + added(m.q)
        return safe

    # --- what the phases ask for ----------------------------------------------------------------

    def _controlled(self, m: Measurement, dt: float) -> np.ndarray | None:
        """Return the torque of the controller; a refusal leads to damping."""
        state, controller = self._state, self._controller
        assert state is not None and self._path is not None
        if self.stage is Stage.LOG:  # the torque is not that of the controller
            self._before, m = m.tau, m._replace(tau=None)
        adapting = self._adapting and not self._resting and self._phase is Phase.RUNNING
        if state.adapting is not adapting:
            state = state.adapt(adapting)
        state = state.gave(self._before)
        try:
            desired = controller.desired(state, self._path, m.t - self._begin)
            torque, after = controller.step(state, m, desired, self._facts.period)
        except PinadaptError as error:
            self._state = state
            words = " ".join(str(error).split())
            self._answer(SafetyFinding("controller", words, Answer.DAMP))
            return None
        self._measured, self._asked, self._goal = m, torque, desired
        self._sought.append((desired.x_d, torque))
        self._state = after
        finding = self._watched(m, dt, after, desired, torque)
        resting = finding is not None and finding.answer is Answer.REST
        self._calm = 0 if resting else self._calm + 1
        if resting and not self._resting and finding is not None:
            self._note(f"the adaptation rests: {finding}")
        if resting or self._calm * self._facts.period > _CALM:
            self._resting = resting
        if finding is not None and self.stage is not Stage.LOG:
            self._answer(finding)
        return torque

    def _watched(
        self,
        m: Measurement,
        dt: float,
        state: ControllerState,
        desired: Desired,
        torque: np.ndarray,
    ) -> SafetyFinding | None:
        """Return what the checklist finds in the motion."""
        sensed, task = state.sensed, self._controller.kinematics.task
        x = sensed.x
        dx = self._still if x is None else task.error(x, desired.x_d)
        self._age = 0.0 if sensed.frame is None else m.t - sensed.frame.t
        added = self._controller.compensation
        motor = torque if added is None else torque + added(m.q)
        sent = self.stage is not Stage.LOG
        disturbance = self._controller.disturbance(state) if sent else None
        return self._checks.of_motion(dt, x, dx, self._age, motor, disturbance)

    def _safe(self, m: Measurement, damping: float, hold: bool = True) -> np.ndarray:
        """Return the torque (n) that compensates gravity and damps [1/s], even if sensors fail."""
        assert self._state is not None
        torque, self._state = self._controller.safe(self._state, m, damping=damping, hold=hold)
        unseen = self._state.unseen
        if unseen.any():
            names = np.array(self._facts.joints)[unseen]
            words = f"neither q nor v of {', '.join(names)} is measured any more; it needs brakes"
            self._answer(SafetyFinding("unseen", words, Answer.STOP))
        return torque

    def _until_rest(self) -> None:
        """Stop once the joints rest, by their plausible velocities, or after a while."""
        assert self._state is not None
        if self._phase is Phase.STOPPED:
            return
        v = np.abs(self._state.sensed.v)
        fastest = float(v.max())
        self._quiet = self._quiet + 1 if fastest < _STILL else 0
        self._since += 1
        damped = self._since * self._facts.period
        if self._quiet >= _QUIET or damped > _DAMP:
            self._enter(Phase.STOPPED, self.ending.reason)
        elif damped > _HOLD and fastest > _SWINGS:
            name, slide = list(self._controller.kinematics.robot.slides.items())[int(v.argmax())]
            words = f"{name} still at {fastest:.2g} {'m/s' if slide else 'rad/s'}"
            self._answer(SafetyFinding("damping", f"{words} after {_HOLD:g} s", Answer.STOP))

    # --- findings, commands, signals ------------------------------------------------------------

    @property
    def _leaving(self) -> bool:
        """Whether the loop is on its way out."""
        return self._phase >= Phase.DAMPING or (self._phase is Phase.HOLDING and not self._halted)

    def _answer(self, finding: SafetyFinding) -> None:
        """Enter the phase of a finding's answer, unless a later one has been entered already."""
        phases = {
            Answer.HOLD: Phase.HOLDING,
            Answer.DAMP: Phase.DAMPING,
            Answer.STOP: Phase.STOPPED,
        }
        phase = phases.get(finding.answer)
        if phase is None:
            return
        if self.stage is Stage.LOG:
            phase = Phase.STOPPED
        if phase is Phase.HOLDING and self.stage is Stage.GRAVITY:
            phase = Phase.DAMPING
        if phase > self._phase or (phase is Phase.HOLDING and self._halted):
            self._enter(phase, str(finding), failed=finding.check not in ("interrupt", "stop"))

    def _enter(self, phase: Phase, why: str, *, failed: bool = False) -> None:
        """Enter a phase and say why."""
        if phase is Phase.HOLDING and self.stage in (Stage.LOG, Stage.GRAVITY):
            phase = Phase.STOPPED if self.stage is Stage.LOG else Phase.DAMPING
        ending = self.ending
        if self._phase in (Phase.STARTING, Phase.RUNNING) or not ending.reason:
            ending.reason = why if phase is not Phase.RUNNING else ""
        ending.failed = ending.failed or failed
        ending.phases.append((self._t - self._begin, phase.name.lower(), why))
        self._say(f"{phase.name.lower()}: {why}")
        if self._recorder is not None:
            self._recorder.event(phase=phase.name.lower(), why=why)
        if phase is Phase.HOLDING and not self._halted:
            self._halt()
        self._phase, self._since, self._quiet, self._halted = phase, 0, 0, False

    def _halt(self) -> None:
        """Let the time of the path come to rest."""
        assert self._path is not None and self._state is not None
        t = self._t - self._begin
        lag = 0.0 if self._state.path is None else self._state.path.lag
        self._path = Retimed(self._path, _Halted(t - lag))

    def _note(self, words: str) -> None:
        self._say(words)
        if self._recorder is not None:
            self._recorder.event(note=words)

    def _log_trouble(self) -> SafetyFinding | None:
        """Is the log being written?"""
        recorder = self._recorder
        assert recorder is not None
        if self._leaving:
            return None
        words = recorder.trouble
        if not words and self.ending.cycles % _ALIVE == 0 and not recorder.alive():
            words = "the process of the log has died"
        return SafetyFinding("log", words, Answer.HOLD) if words else None

    def _ringing(self) -> list[str]:
        """Return at which frequency the last torques of the controller ring, if they do."""
        from ..rollout.recording import ringing_of  # not while the arm moves
        from ..rollout.summary import ringing_words

        if not self._sought:
            return []
        x_d, tau = (np.array(part) for part in zip(*self._sought, strict=True))
        t = self._facts.period * np.arange(len(tau))
        found = ringing_of(t, x_d, tau, self._controller)
        return [] if found is None else [ringing_words(found, self._controller.law.name)]

    def _interrupted(self) -> SafetyFinding:
        """Return what a signal asks for: hold first, then damp, then stop."""
        answer = (Answer.HOLD, Answer.DAMP, Answer.STOP)[min(self._signals, 3) - 1]
        return SafetyFinding("interrupt", "Ctrl-C or a signal", answer)

    @contextmanager
    def _signals_caught(self) -> Iterator[None]:
        """Count signals that would end the program; the cycles heed them."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return

        def count(number: int, frame: FrameType | None) -> None:
            """Count a signal; end at once before the first cycle, and at the fourth."""
            self._signals += 1
            if self._phase is Phase.STARTING or self._signals > 3:
                raise KeyboardInterrupt

        before = {n: signal.signal(n, count) for n in (signal.SIGINT, signal.SIGTERM)}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    def _heed_commands(self, m: Measurement) -> None:
        """Do what other processes ask for."""
        if self._recorder is None:
            return
        for name, value in self._recorder.commands():
            try:
                self._command(name, value, m)
            except PinadaptError as error:
                self._note(f"refused: {error}")

    def _command(self, name: str, value: Any, m: Measurement) -> None:
        """Do one command.

        Raises:
            InputError: it cannot be done now.
        """
        if name == "latch":
            self._checks.latched = str(value or "set by the operator")
        elif name == "stop" and self._phase is not Phase.STARTING:
            self._answer(SafetyFinding("stop", str(value or "commanded"), Answer.HOLD))
        elif name == "hold" and self._phase is Phase.RUNNING and self.stage in _MOVING:
            self._halt()
            self._phase, self._halted = Phase.HOLDING, True
            self.ending.phases.append((self._t - self._begin, "holding", "commanded"))
            self._note("holding: commanded")
        elif name == "go" and self._phase is Phase.HOLDING and self._halted:
            self._resume()
        elif name == "adapt":
            self._adapting = bool(value)
            self._note(f"the adaptation {'goes on' if value else 'rests'}: commanded")
        elif name == "frame" and isinstance(value, Mapping):
            size = self._controller.kinematics.task.coordinates
            age = positive(value.get("age", 0.0), "frame.age", zero=True)
            self._frame = vector(value.get("x", ()), size, "frame.x", fills=False), m.t - age
        elif self._phase is Phase.STARTING:
            raise InputError("the loop has not started.", where=name)
        elif name == "load":
            self._announce(value)
        elif name == "reference" and isinstance(value, Trajectory):
            if self._phase is not Phase.HOLDING or not self._halted:
                raise InputError("hold the path before a new reference.", where="reference")
            lag = 0.0 if self._state is None or self._state.path is None else self._state.path.lag
            self._path = Retimed(value, _Halted(-lag, place=0.0)) if lag else value
            self._begin = self._t
            self._phase, self._halted = Phase.RUNNING, False
            self._note(f"running: new reference, {value!r}")
        else:
            raise InputError(
                f"not while {self._phase.name.lower()} at stage '{self.stage.value}'.", where=name
            )

    def _resume(self) -> None:
        """Let the path go on from where it was halted."""
        assert isinstance(self._path, Retimed)
        t = self._t - self._begin
        lag = 0.0 if self._state is None or self._state.path is None else self._state.path.lag
        place = self._path.law.at(t - lag)[0]
        self._path = Retimed(self._path.motion, _Halted(t - lag, place=place))
        self._phase, self._halted = Phase.RUNNING, False
        self.ending.phases.append((t, "running", "commanded"))
        self._note("running: commanded")

    def _announce(self, table: Any) -> None:
        """Tell the controller of a load that is attached, or of none any more."""
        assert self._state is not None
        self._state = self._controller.announce(self._state, payload=load_of(table))
        self._checks.announced()
        if self._recorder is not None:
            self._recorder.event(load=table)
        self._say(f"load announced: {table}")

    def _record(self, m: Measurement, dt: float, spent: float, began: float) -> None:
        """Hand the cycle to the log."""
        recorder = self._recorder
        assert recorder is not None
        row, state, goal = recorder.row, self._state, self._goal
        row.measured(self._measured)
        row.host[0], row.dt[0], row.phase[0] = began - self._first, dt, self._phase
        row.stepped[0] = self._asked is not None
        row.step_us[0], row.sent[:], row.residual[:] = (
            1e6 * spent, self._sent, self._checks.residual,
        )  # fmt: skip
        row.received[0] = self._arm.received
        row.given[:] = math.nan if self._before is None else self._before
        if self._asked is not None and goal is not None:
            row.asked[:] = self._asked
            row.x_d[:], row.xd_d[:], row.xdd_d[:] = goal
            row.age[0] = self._age
        if state is not None:
            row.adapting[0] = state.adapting
            if self.ending.cycles % 64 == 0:
                recorder.estimates(state.a_k, state.a_d)
        recorder.commit()


_MOVING = (Stage.HOLD, Stage.SLOW, Stage.ADAPT)


def _print(words: str) -> None:
    print(f"pinadapt: {words}", file=sys.stderr, flush=True)


def _stage(stage: Stage | str) -> Stage:
    """Return a stage given as one or by its name.

    Raises:
        InputError: there is none of this name.
    """
    try:
        return Stage(stage)
    except ValueError:
        names = ", ".join(each.value for each in Stage)
        raise InputError(f"must be one of {names}, got {stage!r}.", where="stage") from None


def _check_fit(arm: Arm, controller: Controller) -> None:
    """Refuse an arm that is not the controller's.

    Raises:
        InputError: other joints, another period, torques before the gears, or gravity that is
            compensated by both or neither.
    """
    facts, names = arm.facts, controller.kinematics.joint_names
    if len(facts.joints) != len(names):
        raise InputError(
            f"the arm has {len(facts.joints)} joints {list(facts.joints)}, the controller's robot "
            f"{len(names)}: {names}.",
            where=facts.name,
            hint="Load the description of this arm; lock joints that are not its own.",
        )
    if facts.side != "joint":
        raise InputError(
            "takes torques before its gears; the library computes them behind.",
            where=facts.name,
            hint="Multiply by the ratios in `send` and `read` of the arm.",
        )
    if math.isfinite(controller.period) and abs(controller.period / facts.period - 1.0) > 0.05:
        raise InputError(
            f"has a period of {facts.period:g} s; the controller is made for "
            f"{controller.period:g} s.",
            where=facts.name,
            hint="make_controller(..., dt=...), in a scenario simulation.dt.",
        )
    if (facts.compensation is None) is not (controller.compensation is None):
        adds = "adds" if facts.compensation is not None else "does not add"
        raise InputError(
            f"the arm {adds} its gravity torque by itself, and the controller does not know.",
            where=facts.name,
            hint='make_controller(..., compensated="nominal") for an arm that adds it, in a '
            "scenario simulation.compensated; without it for one that does not.",
        )
    vector(facts.torque, len(names), "torque")
