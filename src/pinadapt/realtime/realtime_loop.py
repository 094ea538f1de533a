"""One loop that runs a controller on an ``Arm`` at its rate, and always ends in damped rest.

    starting -> running -> holding -> damping -> stopped

*Running* is the stage itself: torques computed and not sent, gravity compensation, a hold,
a slow motion, or the motion with adaptation. *Holding*: the time of the path comes to rest within
0.3 s, the estimates rest. *Damping*: gravity compensation and -D v until the joints rest.
*Stopped*: the arm's own stop. The checklist of ``safety`` says which of the last three a finding
leads to.
"""

from __future__ import annotations

import gc
import math
import signal
import sys
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from enum import Enum
from functools import partial
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from .._checks import flag, instance, mapping, positive, vector, word
from .._output import Report, Table
from ..controller.controller import Controller
from ..controller.inputs import InputCheck
from ..controller.residuals import LASTS
from ..controller.state import ControllerState
from ..exceptions import ArmError, InputError, PinadaptError
from ..records import Measurement
from ..reference import starting_from
from ..trajectories.given import TrajectoryLike
from ..trajectories.pose import placed_trajectory
from ..trajectories.trajectory import Hold, Retimed, SlowedTime, SmoothStart, TimeLaw, Trajectory
from .arm import Arm
from .processes import Scheduling
from .recorder import Phase, Recorder, load_of
from .safety import STILL, Checklist, Safety, SafetyFinding, limited_torque

# Steps before the first cycle, by which all kernels have run; half: the same; twice: it starts
# later than ``tell`` waits for the loop.
_WARM_UPS = 60
# [m or rad] that they aim beside the arm, as estimates rest where nothing is off; half, twice: same
_ASIDE = 2e-3
_HALT = 0.3  # [s] until the path rests; half or twice: at twice or half the deceleration
# [s] of holding until the arm is damped, at most for twice as long, and without a finding until the
# adaptation goes on; half or twice: both come as much sooner or later
_SETTLED = 0.5
_RINGING = 2.0  # [s] of torques of which the last second is searched for ringing; twice: two
_FREE = 0.5  # [1/s] damping of a free drive; half, twice: the arm is braked half, twice as much
_SLOWNESS = 5.0  # of a slow motion: half is too fast to step in, twice takes patience
# [s] for the first frame of a camera; half, twice: without one the loop is refused sooner, later
_PATIENCE = 2.0


class Stage(str, Enum):
    """What the loop does, in the order in which an arm should be brought into operation."""

    LOG = "log"  # torques are computed and logged; nothing is sent
    GRAVITY = "gravity"  # gravity compensation, to be moved by hand
    HOLD = "hold"  # the place where the arm is
    SLOW = "slow"  # the motion, slowly, without adaptation
    ADAPT = "adapt"  # the motion with adaptation


def quantiles(times: Counter[int]) -> list[str]:
    """Return median, 99 %, 99.9 % and worst of times that were counted [us]."""
    found = np.percentile(list(times.elements()) or [0], (50.0, 99.0, 99.9, 100.0))
    return [f"{each:.0f}" for each in found]


@dataclass
class RunResult:
    """How a run of the loop ended; ``print`` shows a table.

    Attributes:
        reason: why it ended.
        phases: time [s] since the start, phase, and why it was entered.
        cycles: how many there were.
        late: how many took more than one and a half periods, by either clock.
        step: how often it took which time from a measurement to its torque [us].
        period: the same of the time between measurements by this computer's clock [us].
        notes: what the system did not allow, and what else was noticed.
        state: the last state of the controller; None if it never began.
        failed: whether anything but a command or the end of the time ended it.
    """

    reason: str = ""
    phases: list[tuple[float, str, str]] = field(default_factory=list)
    cycles: int = 0
    late: int = 0
    step: Counter[int] = field(default_factory=Counter)
    period: Counter[int] = field(default_factory=Counter)
    notes: list[str] = field(default_factory=list)
    state: ControllerState | None = None
    failed: bool = False

    def __str__(self) -> str:
        """Return the histogram, the phases and the notes."""
        times = [("step", *quantiles(self.step)), ("period", *quantiles(self.period))]
        rows = [("cycles", f"{self.cycles}, {self.late} late by over half a period")]
        rows += [(phase, f"{t:8.3f} s  {why}") for t, phase, why in self.phases]
        rows += [("note", note) for note in self.notes]
        histogram = Table(times, ("[us]", "median", "99 %", "99.9 %", "worst"))
        return str(Report(f"loop, {self.reason}", [histogram, Table(rows)]))


@dataclass(eq=False)
class _Ramp(TimeLaw):
    """The rate of the path's time s rises from 0 to 1 within a while, or falls where it ``halts``.

    At the instant ``begin`` [s], when it begins to change, the path's time is ``place`` [s].
    """

    begin: float
    place: float
    halts: bool

    _start = SmoothStart(_HALT)

    def at(self, t: float) -> tuple[float, float, float]:
        """Return s [s], ds/dt and d^2s/dt^2 [1/s] at time t [s]."""
        since = t - self.begin
        s, rate, acceleration = self._start.at(since)
        if self.halts:
            s = since - s
            rate = 1.0 - rate
            acceleration = -acceleration
        return self.place + s, rate, acceleration

    def when(self, s: float) -> float:
        """Return the time t [s] at which the path's time is s [s], moving."""
        return self.begin + s - self.place


class RealtimeLoop:
    """A controller on an arm, cycle by cycle, until the time is over or it is stopped.

    Use it inside of the ``with`` statements of the arm and of the recorder, if there is one.

    Attributes:
        stage: what it does.
        safety: numbers of the checklist.
        result: what has happened so far; ``run`` returns it.
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
            scheduling: what is asked of the system; None for the defaults.
            say: gets each message; None prints it to standard error.

        Raises:
            InputError: they do not fit.
        """
        self._arm = instance(arm, Arm, "arm")
        self._controller = instance(controller, Controller, "controller")
        self.stage = Stage(word(stage, [each.value for each in Stage], "stage"))
        self._facts = arm.facts
        self._period = arm.facts.period
        _check_fit(arm, controller)
        kinematics = controller.kinematics
        given = (start or {}).items()
        self._start = {name: part for name, part in given if part is not None}
        known = kinematics.calibrated or "a_k" in self._start
        if self.stage is Stage.SLOW and motion is not None and not known:
            raise InputError(
                "without adaptation the axes of x remain unknown.",
                where="stage",
                hint='Take "adapt", which first finds them by millimetres of motion; or give '
                "start=found.start of what information.find_tracker returns.",
            )
        if motion is not None:
            placed_trajectory(motion, kinematics.robot)  # refused here, and placed at the start
        self._motion = motion
        self.safety = instance(safety or Safety(), Safety, "safety")
        self._checks = Checklist(self.safety, controller, arm.facts)
        self._recorder = recorder
        self._scheduling = scheduling or Scheduling()
        self._say = say or partial(print, "pinadapt:", file=sys.stderr, flush=True)
        self._inputs = InputCheck(kinematics, controller.dynamics.size)
        self._flaw = ""  # of the latest measurement
        self._blind = 0.0  # [s] by this computer's clock, without q and v
        self._sent = np.zeros(kinematics.nv)  # torque by the loop, and that of the motors
        self._given: np.ndarray | None = None
        self._state: ControllerState  # from the first cycle on
        self._path: Trajectory = Hold()
        self._started = self._t = 0.0  # of the run, and now
        self._phase = Phase.STARTING
        self._quiet = 0.0
        self._halted = False  # by a command, which another one takes back
        self._adapting = self.stage is Stage.ADAPT
        self._settled_for = math.inf
        self._frame: dict[str, Any] = {}  # x and x_time, of another process
        self._signals = 0
        self._last: deque[np.ndarray] = deque(maxlen=round(_RINGING / self._period))
        self._tick: dict[str, Any] = {}  # what is recorded of a cycle
        self.result = RunResult()

    # --- a run ----------------------------------------------------------------------------------

    def run(self, duration: float | None = None) -> RunResult:
        """Run until ``duration`` [s] is over, a command or a finding ends it; None: no end.

        The arm is stopped whatever happens.

        Raises:
            InputError, MeasurementError: the arm is where the controller cannot start.
            ArmError: the arm refuses to begin, its first measurements cannot be used, or another
                loop drives it.
        """
        result = self.result
        if duration is not None:
            positive(duration, "duration", error=InputError)
        if self._phase is not Phase.STARTING:
            raise InputError("has run.", where="loop", hint="Make another one.")
        with ExitStack() as back, threadpool_limits(1, "blas"):
            lock = vars(self._arm).setdefault("_driven", threading.Lock())
            if not lock.acquire(blocking=False):
                raise ArmError(
                    "is driven by another loop.",
                    where=self._facts.name,
                    hint="Let that end first, and use one loop for one arm.",
                )
            back.callback(lock.release)
            if gc.isenabled():
                back.callback(gc.enable)
            self._catch_signals(back)
            for note in back.enter_context(self._scheduling.applied()):
                self._note(note)
            try:
                self._cycles(self._prepared(), duration)
            except BaseException as error:
                begun = self._phase is not Phase.STARTING
                expected = isinstance(error, ArmError)
                words = str(error) if expected else f"{type(error).__name__}: {error}"
                self._enter(Phase.STOPPED, words, failed=True)
                if not (begun and expected):
                    raise
            finally:
                self._arm.stop(result.reason or "the loop has ended")
                result.state = vars(self).get("_state")
                result.notes += self._ringing()
                if self._recorder is not None and self._recorder.trouble:
                    result.notes.append(self._recorder.trouble)
        return result

    def _prepared(self) -> Measurement:
        """Return the first measurement, after the controller has run and its memory is touched."""
        controller = self._controller
        start = {name: np.asarray(part).tolist() for name, part in self._start.items()}
        self._event(begun={"stage": self.stage.value, "start": start, "period": self._period})
        first = m = self._first_frame()
        state = controller.init(m, **self._start)
        self._path = Hold.of(controller.kinematics.task, m)
        if self._motion is not None and self.stage in (Stage.LOG, Stage.SLOW, Stage.ADAPT):
            self._path = starting_from(self._motion, controller.kinematics.seen(state.a_k), m)
            if self.stage is Stage.SLOW:
                self._path = Retimed(self._path, SlowedTime(_SLOWNESS))
        self._warm_up(state, m)
        if state.start is not None:  # what follows it as well
            self._warm_up(controller.init(m, **{**self._start, "a_k": state.a_k}), m)
        if controller.disturbance(state) is None:
            self._note("contact is not detected: law and adaptation observe no disturbance")
        gc.collect()
        gc.disable()
        self._arm.read()
        if self.stage is not Stage.LOG:
            self._arm.begin()
        m = self._read()
        if m.x is None:
            m = m._replace(x=first.x)  # the arm rests, so an old frame is still valid
        self._started = self._t = m.t
        self._controller = controller = controller.resting_at(m.q)
        self._state = controller.init(m, **self._start).adapt(self._adapting)
        # what holds the arm as the brakes have held it
        self._sent, _ = controller.safe(self._state, m, damping=0.0)
        self._enter(Phase.RUNNING, f"stage '{self.stage.value}'", commanded=True)
        return m

    def _warm_up(self, state: ControllerState, m: Measurement) -> None:
        """Run the controller from a state, beside the arm's place, and forget what came of it.

        Raises:
            PinadaptError: the controller refuses the measurement.
        """
        controller = self._controller
        period = self._period
        task = controller.kinematics.task
        aside = Hold.of(task, m).shifted(np.full(task.size, _ASIDE))
        for k in range(_WARM_UPS):
            m = m._replace(t=m.t + period)
            desired = controller.desired(state, aside, k * period)
            torque, state = controller.step(state.adapt(True), m, desired, period)
            if m.tau is not None:  # the brakes hold the arm: it is not what is asked for
                m = m._replace(tau=self._of_motors(torque, m))
        controller.safe(state, m)

    def _first_frame(self) -> Measurement:
        """Return the first measurement with a frame of the camera, if the task needs one.

        Raises:
            ArmError: none comes.
        """
        for _ in range(round(_PATIENCE / self._period)):
            m = self._read()
            if m.x is not None or not self._controller.kinematics.positions:
                return m
            if not self._facts.paced:
                time.sleep(self._period)
        raise ArmError(
            f"no position of the task frame came for {_PATIENCE:g} s.",
            where=self._facts.name,
            hint="Does the camera run? Without one take a joint task.",
        )

    def _read(self) -> Measurement:
        """Return the next measurement, and do what other processes ask for; set ``_flaw``.

        Raises:
            ArmError: something is wrong with it before anything moves.
        """
        given = self._arm.read()
        kinematics = self._controller.kinematics
        unknown = np.full(kinematics.nq, np.nan), np.full(kinematics.nv, np.nan)
        m = Measurement(self._t + self._period, *unknown)
        self._flaw = ""
        try:
            m = self._inputs.measurement(given)._replace(tau=None)
            m = m._replace(tau=self._inputs.torque(given.tau))
            self._inputs.finite(m)
        except Exception as error:  # whatever an object of a driver does
            self._flaw = str(error).partition("\n")[0]
        if self._flaw and self._phase is Phase.STARTING:
            raise ArmError(self._flaw, where=self._facts.name)
        if self.stage is Stage.LOG:  # the torque is not that of the controller
            self._given = m.tau
            m = m._replace(tau=None)
        self._t = m.t
        if self._recorder is not None:
            for name, value in self._recorder.commands():
                try:
                    self._command(name, value)
                except PinadaptError as error:
                    self._note(f"refused: {error}")
        if m.x is None:
            m = m._replace(**self._frame)
            self._frame = {}
        return m

    def _cycles(self, m: Measurement, duration: float | None) -> None:
        """Run the cycles from the first measurement on."""
        result = self.result
        clock = time.perf_counter
        due = arrived = first = clock()
        host = dt = 0.0
        while True:
            state = self._state
            self._tick |= {
                "host": arrived - first,
                "dt": dt,
                **m._asdict(),
                "a_k": state.a_k,
                "a_d": state.a_d,
                "adapting": state.adapting,
                "given": self._given,
                "received": self._arm.received,
                "asked": None,
            }
            torque = self._cycle(m, dt, host)
            if torque is not None:
                self._arm.send(torque.copy())
            spent = clock() - arrived
            result.step[round(1e6 * spent)] += 1
            result.cycles += 1
            if self._recorder is not None:
                self._tick |= {"step_us": 1e6 * spent, "phase": self._phase, "sent": self._sent}
                self._recorder.record(self._tick)
            if self._phase is Phase.STOPPED:
                return
            over = duration is not None and m.t - self._started >= duration
            if over and (self._phase is Phase.RUNNING or self._halted):
                self._enter(Phase.HOLDING, "the time is over")
            due += self._period
            if clock() > due + self._period:
                due = clock()  # missed deadlines are not made up for
            if not self._facts.paced:
                time.sleep(max(due - clock(), 0.0))
            latest = self._read()
            now = clock()
            dt = latest.t - m.t
            host = now - arrived
            m = latest
            arrived = now
            result.period[round(1e6 * host)] += 1
            host = 0.0 if self._facts.clock == "simulated" else host
            seen = np.isfinite(m.q).all() or np.isfinite(m.v).all()
            self._blind = 0.0 if seen else self._blind + host
            result.late += max(dt, host) > 1.5 * self._period

    def _cycle(self, m: Measurement, dt: float, host: float) -> np.ndarray | None:
        """Return the torque (n) to send now, or None in log-only mode and after the end."""
        recorder = self._recorder
        if self._signals:  # the first one holds, the second one damps, the third one stops
            phase = Phase(min(Phase.RUNNING + self._signals, Phase.STOPPED))
            self._respond(SafetyFinding("interrupt", "Ctrl-C or a signal", phase))
        if self._flaw:
            self._respond(SafetyFinding("driver", self._flaw, Phase.DAMPING))
        self._respond(self._checks.of_arm(m, dt, host, self._arm.received))
        if recorder is not None and recorder.trouble:
            self._respond(SafetyFinding("log", recorder.trouble, Phase.HOLDING))
        torque: np.ndarray | None = None
        if self._phase is Phase.RUNNING and self.stage is Stage.GRAVITY:
            torque = self._safe(m, _FREE, hold=False)
        elif self._phase in (Phase.RUNNING, Phase.HOLDING):
            torque = self._controlled(m, dt)
        if self._phase is Phase.DAMPING:
            torque = self._safe(m, self.safety.damping, beside=self._checks.unexplained)
        self._advance()
        if torque is None or self._phase is Phase.STOPPED or self.stage is Stage.LOG:
            return None
        if not np.isfinite(torque).all():
            self._respond(SafetyFinding("controller", "a torque is not finite", Phase.STOPPED))
            return None
        change = self._checks.rate * max(dt, self._period)
        self._sent = limited_torque(torque, self._checks.limit, self._sent, change)
        self._given = self._of_motors(self._sent, m)
        return self._sent

    # --- what the phases ask for ----------------------------------------------------------------

    def _controlled(self, m: Measurement, dt: float) -> np.ndarray | None:
        """Return the torque of the controller; a refusal leads to damping."""
        controller = self._controller
        logging = self.stage is Stage.LOG
        adapting = self._adapting and self._settled_for > _SETTLED and self._phase is Phase.RUNNING
        state = self._state.adapt(adapting).gave(self._given)
        try:
            desired = controller.desired(state, self._path, m.t - self._started)
            torque, after = controller.step(state, m, desired, self._period)
        except Exception as error:  # a motion of the user's own may raise anything
            self._state = state
            words = " ".join(str(error).split())
            if not isinstance(error, PinadaptError):
                words = f"{type(error).__name__}: {words}"
            self._respond(SafetyFinding("controller", words, Phase.DAMPING))
            return None
        self._last.append(torque)
        self._state = after
        feet = getattr(desired.feet, "table", None)
        self._tick |= {"asked": torque, "adapting": adapting, "feet": feet, **desired._asdict()}
        sensed = after.sensed
        x = np.asarray(sensed.x)
        dx = controller.kinematics.task.error(x, desired.x_d)
        age = 0.0 if sensed.frame is None else m.t - sensed.frame.t
        pushed = None if logging else controller.disturbance(after)
        finding = self._checks.of_motion(dt, x, dx, age, self._of_motors(torque, m), pushed)
        self._tick["residual"] = self._checks.residual
        if finding is not None and finding.phase is Phase.RUNNING:
            if self._settled_for > _SETTLED:
                self._note(f"the adaptation rests: {finding}")
            self._settled_for = 0.0
        else:
            self._settled_for += self._period
        if not logging:
            self._respond(finding)
        return torque

    def _of_motors(self, torque: np.ndarray, m: Measurement) -> np.ndarray:
        """Return the torque (n) of the motors, with what the arm adds by itself."""
        added = self._controller.compensation
        return torque if added is None else torque + added(m.q)

    def _safe(self, m: Measurement, damping: float, **options: Any) -> np.ndarray:
        """Return the torque (n) that compensates gravity and damps [1/s], even if sensors fail."""
        torque, self._state = self._controller.safe(self._state, m, damping=damping, **options)
        unseen = self._state.unseen | (self._blind > max(LASTS - self._period, 0.0))
        if unseen.any():
            names = ", ".join(np.array(self._facts.joints)[unseen])
            words = f"neither q nor v of {names} is measured any more; it needs brakes"
            self._respond(SafetyFinding("unseen", words, Phase.STOPPED))
        return torque

    def _advance(self) -> None:
        """Go on from holding to damping after a while, and from there once the joints rest."""
        self._since += self._period
        if self._phase is Phase.HOLDING and self._since > _SETTLED and not self._halted:
            self._enter(Phase.DAMPING, "the path rests")
        elif self._phase is Phase.DAMPING:  # at rest for a time constant of the damping
            still = np.abs(self._state.sensed.v).max() < STILL
            self._quiet = self._quiet + self._period if still else 0.0
            if self._quiet * self.safety.damping > 1.0 or self._since > 2.0 * _SETTLED:
                self._enter(Phase.STOPPED, self.result.reason)

    # --- findings, commands, signals ------------------------------------------------------------

    def _respond(self, finding: SafetyFinding | None) -> None:
        """Enter the phase of a finding, unless it or a later one has been entered already."""
        if finding is None:
            return
        phase = finding.phase
        failed = finding.check not in ("interrupt", "stop")
        if phase > self._phase or (phase is Phase.HOLDING and self._halted):
            self._enter(phase, str(finding), failed=failed)

    def _enter(
        self, phase: Phase, why: str, *, failed: bool = False, commanded: bool = False
    ) -> None:
        """Enter a phase and say why; one that is commanded does not end the run."""
        if phase is not Phase.RUNNING and self.stage is Stage.LOG:
            phase = Phase.STOPPED
        if phase is Phase.HOLDING and self.stage is Stage.GRAVITY:
            phase = Phase.DAMPING
        result = self.result
        name = phase.name.lower()
        if not commanded:
            result.reason = result.reason or why
        result.failed = result.failed or failed
        result.phases.append((self._t - self._started, name, why))
        self._say(f"{name}: {why}")
        self._event(phase=name, why=why)
        if phase is Phase.HOLDING and not self._halted:
            self._path = Retimed(self._path, _Ramp(self._now, self._now, halts=True))
        self._phase = phase
        self._since = 0.0
        self._quiet = 0.0
        self._halted = commanded and phase is Phase.HOLDING

    @property
    def _now(self) -> float:
        """The time of the path, less what the governor has it wait [s]."""
        path = self._state.path
        return self._t - self._started - (0.0 if path is None else path.lag)

    def _note(self, words: str) -> None:
        self.result.notes.append(words)
        self._say(words)
        self._event(note=words)

    def _event(self, **what: Any) -> None:
        if self._recorder is not None:
            self._recorder.event(**what)

    def _ringing(self) -> list[str]:
        """Return at which frequency the last torques of the controller ring, if they do."""
        from ..rollout.recording import ringing_of  # not while the arm moves
        from ..rollout.summary import ringing_words

        tau = np.reshape(self._last, (-1, self._sent.size))
        found = ringing_of(self._period * np.arange(len(tau)), tau, self._controller)
        return [] if found is None else [ringing_words(found, self._controller)]

    def _catch_signals(self, back: ExitStack) -> None:
        """Count signals that would end the program, until all is given ``back``."""

        def count(*_: object) -> None:
            """Count a signal; end at once before the first cycle, and at the fourth."""
            self._signals += 1
            if self._phase is Phase.STARTING or self._signals > 3:
                raise KeyboardInterrupt

        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, signal.SIGTERM):
                back.callback(signal.signal, number, signal.signal(number, count))

    def _command(self, name: str, value: Any) -> None:
        """Do one command.

        Raises:
            InputError: it cannot be done now.
        """
        begun = self._phase is not Phase.STARTING
        moving = self._phase is Phase.RUNNING and self.stage not in (Stage.LOG, Stage.GRAVITY)
        path = self._path if self._halted else None
        place, rate, _ = path.law.at(self._now) if isinstance(path, Retimed) else (0.0, 1.0, 0.0)
        if name == "latch":
            self._checks.latched = str(value or "set by the operator")
        elif name == "adapt":
            self._adapting = flag(value, name)
            self._note(f"the adaptation {'goes on' if value else 'rests'}: commanded")
        elif name == "frame":
            value = mapping(value, name)
            for key in value:
                word(key, ("x", "age"), name)
            age = positive(value.get("age", 0.0), "frame.age", zero=True)
            size = self._controller.kinematics.task.coordinates
            x = vector(value.get("x", ()), size, "frame.x", fills=False)
            self._frame = {"x": x, "x_time": self._t - age}
        elif name == "stop" and begun:
            self._respond(SafetyFinding("stop", str(value or "commanded"), Phase.HOLDING))
        elif name == "load" and begun:
            after = self._controller.announce(self._state, payload=load_of(value))
            dynamics = self._controller.dynamics
            dynamics.load(after.a_d)
            v = np.zeros(self._checks.limit.size)
            if (np.abs(dynamics.torque(after.sensed.q, v, v)) > self._checks.limit).any():
                raise InputError("the motors cannot hold the arm with it.", where=name)
            self._state = after
            self._checks.announced()
            self._event(load=value)
            self._say(f"load announced: {value}")
        elif name == "hold" and moving:
            self._enter(Phase.HOLDING, "commanded", commanded=True)
        elif name == "go" and isinstance(path, Retimed) and not rate:
            self._go(path.motion, place, "commanded")
        elif name == "reference" and not rate:
            stands = self._state.stands
            if stands is not None and not stands.all():
                raise InputError("a foot is in the air.", where=name, hint="`go` ends the step.")
            instance(value, Trajectory, name)
            self._go(value, 0.0, f"new reference, {value!r}")
        else:
            held = ", or before the path rests by `hold`" if name in ("go", "reference") else ""
            raise InputError(
                f"not while {self._phase.name.lower()} at stage '{self.stage.value}'{held}.",
                where=name,
            )

    def _go(self, motion: Trajectory, place: float, why: str) -> None:
        """Move on along a motion from a place [s] of its own time, at rest there."""
        self._path = Retimed(motion, _Ramp(self._now, place, halts=False))
        self._enter(Phase.RUNNING, why, commanded=True)


def _check_fit(arm: Arm, controller: Controller) -> None:
    """Refuse an arm that is not the controller's.

    Raises:
        InputError: other joints or the same in another order, another period, or gravity that is
            compensated by both or neither.
    """
    facts = arm.facts
    own = list(facts.joints)
    names = list(controller.kinematics.joint_names)
    reordered = own != names and sorted(own) == sorted(names)
    if len(own) != len(names) or reordered:
        raise InputError(
            f"the arm has {len(own)} joints {own}, the controller's robot {len(names)}: {names}.",
            where=facts.name,
            hint="Load the description of this arm, whose order of joints counts; lock joints that "
            "are not its own.",
        )
    if math.isfinite(controller.period) and abs(controller.period / facts.period - 1.0) > 0.05:
        raise InputError(
            f"has a period of {facts.period:g} s; the controller is made for "
            f"{controller.period:g} s.",
            where=facts.name,
            hint="make_controller(..., dt=...), in a scenario controller.dt.",
        )
    if (facts.compensation is None) is not (controller.compensation is None):
        raise InputError(
            "only one of arm and controller knows that the arm adds its gravity torque by itself.",
            where=facts.name,
            hint='make_controller(..., compensated="nominal") for an arm that adds it, in a '
            "scenario controller.compensated; without it for one that does not.",
        )
