"""The result of an identification, and its report."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from html import escape
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from .._output import Printed, Report, Table, as_json, html_page, write_json, write_text
from .._version import __version__
from ..adaptation.adaptation import Estimate
from ..controller.controller import Controller
from ..controller.learned import LearnedParameters
from ..controller.state import ControllerState
from ..exceptions import InputError, ParameterError
from ..information.information import CERTAIN, Excitation, Information, lateness
from ..information.measured_motion import Averages, MeasuredMotion, evenly
from ..information.payload import (
    ArmPrior,
    PayloadEstimate,
    described_robot,
    described_values,
    payload_estimate,
    payload_of_uncertain_arm,
)
from ..logs.import_options import ImportOptions
from ..logs.log import Log
from ..models.excited import rms
from ..records import Measurement
from ..robot.robot import Robot
from ..simulation.simulate import watched
from ..tuning.unknowns import Unknown, nominal_dynamics
from .estimator import Estimate as OnlineEstimate
from .estimator import Estimator
from .fits import GAIN, TINY, Windows, lasting_noise, torque_information
from .selection import ChosenEffects
from .torque_check import HEAVIEST, TorqueCheck

_TIMES = 20  # at which estimates are asked for, for the picture: half, twice as many points
FILES = (
    "torque.png",
    "parameters.png",
    "learned.json",
    "learned.urdf",
    "import_options.toml",
    "report.html",
    "learned.xml",
    "summary.json",
)


class Parameter(NamedTuple):
    """An identified parameter: described, value and known_to in its unit."""

    name: str
    described: float
    value: float
    known_to: float
    unit: str


class Errors(NamedTuple):
    """Root mean squares over time of n joints or m coordinates.

    Attributes:
        size: (n) of the measured signal, less its mean for positions [N m, N or m].
        described_held_out: (n) error of the description, over the held-out part.
        learned_held_out: (n) error of the estimate from the first part, over the held-out part.
        gain: factor by which the held-out error falls, all signals together; None without data.
    """

    size: np.ndarray
    described_held_out: np.ndarray
    learned_held_out: np.ndarray
    gain: float | None

    def change(self, scale: float = 1.0) -> str:
        """Return the errors of the held-out part before and after, in words."""
        return " -> ".join(f"{scale * rms(part):.3g}" for part in self[1:3])


def plain(value: Any) -> Any:
    """Return a value of what JSON has, records as their fields."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if hasattr(value, "_asdict"):
        value = value._asdict()
    if isinstance(value, dict):
        return {key: plain(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [plain(part) for part in value]
    return value


@dataclass(frozen=True, eq=False, repr=False)
class Identification(Printed):
    """A robot identified from a log, in SI units; ``print`` shows a report.

    Attributes:
        log: the motion, its columns in the order of the joints.
        motion: in it, with the velocities that were used, and the torques over their gains.
        described: the robot as described.
        controller: with the models and the names of the parameters.
        windows: equations of the torque, averaged over windows.
        rows: equations of the positions.
        split: time [s] from which on the log was held out once.
        dynamic: the dynamic parameters from the whole log, with their information.
        kinematic: the translations from the whole log, likewise.
        before_split: (p_d) the dynamic parameters from the log before ``split``.
        position_before_split: (p_k) the translations from it.
        estimator: of the online estimates.
        unknown: what was identified. A controller with the same parameters is
            ``make_controller(found.robot, unknown=found.unknown)``.
        stated: equations that were stated beside the log, such as a total mass, see ``torque_fit``.
        effects: of the joints, as cross-validation chose them; None where the caller named them.
        tested: names of the logs that were held out; empty where it is the last part of one log.
        load: estimated from this log and one without it; None without such a log.
        gains: by which measured torques exceed the true ones, one a joint, if a load was known.
        check: the comparison of the torques with the description, None where none were needed.
        import_options: how the log was read.
    """

    log: Log
    motion: MeasuredMotion
    described: Robot
    controller: Controller
    windows: Windows
    rows: Windows
    split: float
    dynamic: Information
    kinematic: Information
    before_split: np.ndarray
    position_before_split: np.ndarray
    estimator: Estimator
    unknown: Unknown
    stated: np.ndarray
    effects: ChosenEffects | None
    tested: tuple[str, ...]
    load: PayloadEstimate | None
    gains: Information | None
    check: TorqueCheck | None
    import_options: ImportOptions

    @property
    def state(self) -> ControllerState:
        """The state of a controller with these estimates; see ``Controller.learned``."""
        a_d = self.dynamic.estimate
        return ControllerState(
            self.motion.t[0],
            Estimate(a_d),
            Estimate(self.kinematic.estimate),
            a_d,
            filters=(),
        )

    @property
    def robot(self) -> Robot:
        """The robot with the estimated parameters; ``robot.save("learned.urdf")`` writes it.

        Raises:
            ParameterError: a body is on the border of what is physical.
        """
        return replace(
            self.controller.learned(self.state),
            drawn=self.described.drawn,
            task=self.described.task,
        )

    def parameters(self) -> LearnedParameters:
        """Return the estimates by name and their information, from which a controller can start."""
        return LearnedParameters.of(self.controller, self.state, rows=self.dynamic.R)

    def payload(self, *, gain: float = GAIN) -> PayloadEstimate:
        """Return the load that best explains the change of all bodies, and what else does.

        With a log of the arm without its load: the load that explains the difference, as
        ``identify`` found it with the default gain.

        Args:
            gain: deviation of the torques' gains from one; zero where they are exact.

        Raises:
            ParameterError: the body of the task frame is not among the parameters.
            RobotError: there are several task frames.
        """
        self.described.check_single_frame()
        if self.load is not None:
            return self.load
        plain = self._load_of(self.dynamic)
        if not gain:
            return plain
        windows = self.windows.between(last=self.split) if self.tested else self.windows
        a = self.dynamic.estimate
        gains = np.ones(windows.tau.shape[1])
        found = torque_information(a, windows, self.stated, gains, gain).marginal(a.size)
        (own, known), (value, other) = plain.numbers, self._load_of(found).numbers
        known = np.hypot(known, np.hypot(other, value - own))
        return PayloadEstimate(own, known, plain.explained)

    def _load_of(self, found: Information) -> PayloadEstimate:
        """Return the load that explains the change of the bodies, by their information."""
        controller = self.controller
        dynamics = controller.dynamics
        if dynamics.per_body and len(dynamics.bodies) == len(self.described.joint_names):
            return payload_of_uncertain_arm(controller, dynamics, found)
        return payload_estimate(
            controller, found, ArmPrior.of(described_robot(controller), dynamics, 0.0)
        )

    def excitation(self) -> Excitation:
        """Return which parameters the motion can identify, and how well."""
        return Excitation(self.dynamic, self.kinematic, self.parameters().units)

    @cached_property
    def described_parameters(self) -> np.ndarray:
        """The dynamic parameters (p_d) of the description, its friction and rotors included."""
        return described_values(self.controller.dynamics, self.controller.kinematics.robot)

    @cached_property
    def torque_errors(self) -> Errors:
        """Errors of the window-averaged torques of the joints (n) [N m or N]."""
        return self._errors(self.windows, self.described_parameters, self.before_split)

    @cached_property
    def online(self) -> dict[float, OnlineEstimate]:
        """Estimates by their times [s], as on the robot, the last one before ``split`` among them.

        The estimator runs through the log sample by sample when this is asked for.
        """
        return _online(self.estimator, self.motion, self.split)

    @cached_property
    def online_held_out(self) -> np.ndarray:
        """Errors (n) of the held-out torques with the online estimate at the split [N m or N]."""
        return self._held_out(self.online[max(t for t in self.online if t < self.split)].robot)

    def _held_out(self, robot: Robot) -> np.ndarray:
        """Return the errors (n) of the held-out torques with another robot [N m or N].

        It is mounted as the described one.
        """
        robot = ImportOptions(gravity=self.described.model.gravity.linear).mounted(robot)
        nothing = Unknown(bodies="none", friction=False, armature=False)
        dynamics = nominal_dynamics(robot, nothing, ())
        averages = Averages(self.motion.t, self.log.period)
        windows = Windows.of(self.motion, averages, dynamics, robot)
        return rms(windows.between(self.split).y, 0)

    @cached_property
    def late(self) -> tuple[float, float]:
        """How much later the torques seem to be than the positions, and its deviation [s].

        The torque's rate is that of the prediction: noise of a measured one would hide lateness.
        """
        from scipy.interpolate import CubicSpline  # here, because scipy is slow to import

        windows = self.windows
        left = windows.residual(self.dynamic.estimate)
        rate = CubicSpline(windows.t, windows.tau - left)(windows.t, 1)
        return lateness(windows.W, left, rate, lasting_noise(left) + TINY)

    def _notes(self) -> Iterator[str]:
        """Yield what a user should look at: another clock, bodies or a load that cannot be."""
        if not self.dynamic.names:
            return
        late, known = self.late
        if abs(late) > max(
            CERTAIN * known, 0.1 * self.log.period
        ):  # half, twice: told from there on
            yield (
                f"the torques seem to be {1e3 * late:.2g} +- {1e3 * known:.1g} ms later than the "
                "positions; part of this is learned as friction and inertia."
            )
        for name, old, now in zip(
            self.dynamic.names, self.described_parameters, self.dynamic.estimate, strict=True
        ):
            if name.endswith(".m") and not 0.5 * old <= now <= 2.0 * old:
                yield f"the mass of {name[:-2]} changed from {old:.3g} to {now:.3g} kg."
        load = self._loaded
        if load is not None and not self._carried:
            yield (
                f"no load explains the change of the bodies: it would be {load.mass:.3g} +- "
                f"{load.mass_known_to:.2g} kg, which this arm cannot carry or lack."
            )

    @cached_property
    def position_errors(self) -> Errors | None:
        """Errors of the positions (m) [m], or None where no translation was estimated."""
        if not len(self.rows.between(self.split).t) or not self.kinematic.names:
            return None
        return self._errors(
            self.rows, self.controller.kinematics.initial, self.position_before_split
        )

    def _errors(self, windows: Windows, described: np.ndarray, learned: np.ndarray) -> Errors:
        """Return the errors of two parameters (p) in the held-out part."""
        last = windows.between(self.split)
        size, before, after = (
            rms(part, 0) for part in (windows.tau, last.residual(described), last.residual(learned))
        )
        return Errors(size, before, after, rms(before) / rms(after) if rms(after) > 0.0 else None)

    @property
    def trusted(self) -> bool:
        """Whether the log can be one of the described robot, by its torques and positions."""
        return (self.check is None or self.check.fits) and self._far_off is None

    @property
    def _far_off(self) -> float | None:
        """Error of the positions as identified [m], where it is that of another robot."""
        positions = self.position_errors
        if positions is None or not self.described.task.positions or not self.dynamic.names:
            return None
        off = float(np.linalg.norm(positions.learned_held_out))
        return off if off > 0.02 * self.described.reach else None

    @property
    def verdict(self) -> str:
        """The result in one line."""
        if self.check is not None and not self.check.fits:
            return f"NOT TO BE TRUSTED: {self.check.verdict}"
        if self.position_errors is not None and not self.dynamic.names:
            return f"error of held-out positions: {self.position_errors.change(1e3)} mm (rms)."
        gain = self.torque_errors.gain or 0.0
        words = f"error of held-out torques: {self.torque_errors.change()} {self._unit} (rms), "
        words += f"{gain:.3g} times less"
        if self._far_off is not None:
            return (
                f"NOT TO BE TRUSTED: {words}. The positions are {1e3 * self._far_off:.3g} mm off "
                "even as identified. Are they in metres, and of this robot, frame and base?"
            )
        if gain >= 2.0:
            return f"{words}."
        if gain < 1.0:
            return f"{words}: WORSE. The estimate from the first part does not predict the last."
        return f"{words}, hardly better than the description, which may be correct already."

    @property
    def _unit(self) -> str:
        """Unit of the torques."""
        return "N m or N" if self.described.sliding.any() else "N m"

    @cached_property
    def _loaded(self) -> PayloadEstimate | None:
        """The load, None where its body was not among the parameters, or could be several."""
        try:
            return self.payload()
        except InputError:
            return None

    @property
    def _carried(self) -> bool:
        """Whether the load, less its deviation, is one that the arm can carry, or lack."""
        load = self._loaded
        if load is None:
            return False
        robot = self.described
        lightest = -robot.model.inertias[robot.carriers[0] + 1].mass - load.mass_known_to
        return bool(lightest <= load.mass <= HEAVIEST * robot.mass + load.mass_known_to)

    def _rows(self, part: Information, described: np.ndarray) -> list[Parameter]:
        """Return a record of each parameter."""
        units = self.parameters().units
        numbers = (each.tolist() for each in (described, part.estimate, part.deviations))
        return list(map(Parameter, part.names, *numbers, (units.get(n, "") for n in part.names)))

    @cached_property
    def _record(self) -> dict[str, Any]:
        """What there is to say: text, page and ``summary.json`` follow from it."""
        log = self.log
        return {
            "verdict": self.verdict,
            "log": log.source,
            "robot": self.described.name,
            "joint_names": self.described.joint_names,
            "samples": len(log.t),
            "left_out": int(np.count_nonzero(~log.finite)),
            "duration": log.duration,
            "velocities": "from the positions" if self.motion.smoothed else "as measured",
            "windows": len(self.windows.t),
            "held_out_from": self.split,
            "tested": self.tested,
            "notes": tuple(self._notes()),
            "check": None if self.check is None else self.check.summary(),
            "torque": self.torque_errors if self.dynamic.names else None,
            "torque_online_held_out": self.online_held_out,
            "position": self.position_errors,
            "dynamic_identifiable": self.dynamic.rank,
            "dynamic": self._rows(self.dynamic, self.described_parameters),
            "kinematic": self._rows(self.kinematic, self.controller.kinematics.initial),
            "effects": () if self.effects is None else self.effects.gains,
            "gains": () if self.gains is None else self._rows(self.gains, self.gains.estimate**0),
            "payload": vars(self._loaded) if self._carried else None,
            "version": __version__,
        }

    def summary(self) -> dict[str, Any]:
        """Return the numbers of ``summary.json``; None stands for what is not finite."""
        return as_json(plain(self._record))

    def report(self, compared: Mapping[str, Robot] | None = None) -> Report:
        """Return the whole report, with the held-out errors of other models by name.

        Raises:
            ParameterError: a compared robot has other joints.
        """
        of = self._record
        rows = [
            (name.replace("_", " "), value)
            for name, value in of.items()
            if isinstance(value, str | float | int) and name != "verdict"
        ]
        if self.position_errors is not None:
            rows.append(("held-out positions", f"{self.position_errors.change(1e3)} mm (rms)"))
        rows += [("note", note) for note in of["notes"]]
        tables = [Table(rows)]
        if self.check is not None:
            tables.append(self.check.table())
        if self.dynamic.names:
            tables.append(self._torque_table(compared or {}))
        if self._carried:
            tables.append(self.payload().table())
        for part in ("effects", "gains", "kinematic", "dynamic"):
            records = [one for one in of[part] if np.isfinite(getattr(one, "known_to", 0.0))]
            if records:
                header = [name.replace("_", " ") for name in records[0]._fields]
                tables.append(Table(records, header, part))
        return Report(
            f"{self.described.name}, identified from {self.log.source}", tables, self.verdict
        )

    def _torque_table(self, compared: Mapping[str, Robot]) -> Table:
        """Return held-out errors of the torques, one row for each joint.

        Raises:
            ParameterError: a compared robot has other joints.
        """
        errors = self.torque_errors
        joints = self.described.joint_names
        columns = {"torque": errors.size, "described": errors.described_held_out}
        for name, robot in compared.items():
            if robot.joint_names != joints:
                raise ParameterError(
                    f"its joints are {robot.joint_names}, those of the log {joints}.",
                    where=f"compared model {robot.name}",
                )
            columns[name] = self._held_out(robot)
        columns |= {"identified": errors.learned_held_out, "online": self.online_held_out}
        values = np.array([[*part, rms(part)] for part in columns.values()]).T
        rows = [
            (name, *(f"{value:.3g}" for value in row), "")
            for name, row in zip([*joints, f"all, rms, {self._unit}"], values, strict=True)
        ]
        return Table(rows, ("error of held-out torques", *columns, ""))

    def save(
        self,
        folder: Path | str,
        *,
        mjcf: bool = False,
        compared: Mapping[str, Robot] | None = None,
    ) -> None:
        """Write the report, its pictures, the robot, and its parameters: see ``FILES``.

        Args:
            folder: that takes the files.
            mjcf: whether to write ``learned.xml`` too, see ``Robot.mjcf``.
            compared: as of ``page``.

        Raises:
            ParameterError: files that could not be written; the others are.
            OSError: they cannot be written.
        """
        folder = Path(folder)
        for name, figure in vars(self.plot()).items():
            write_text(folder / f"{name}.png", figure.png(dpi=130))
        self.parameters().save(folder / "learned.json")
        about = f"How {Path(self.log.source).name} was read."
        write_text(folder / "import_options.toml", self.import_options.text([about]))
        write_json(folder / "summary.json", self.summary())
        missing = []
        for name in ("report.html", "learned.urdf", "learned.xml")[: 2 + mjcf]:
            try:
                if name == "report.html":
                    write_text(folder / name, self.page(compared))
                else:
                    self.robot.save(folder / name)
            except InputError as reason:
                missing.append(f"{name}: {reason}")
        if missing:
            raise ParameterError("; ".join(missing), where="not written")

    def page(self, compared: Mapping[str, Robot] | None = None) -> str:
        """Return the report as one web page with pictures, without external resources.

        Args:
            compared: other models of the same chain by name, such as a published one, with their
                friction; the page compares their errors.

        Raises:
            ParameterError: a compared robot has other joints.
        """
        whole = self.report(compared)
        data = b64encode(self.plot().torque.png(dpi=100)).decode()
        return html_page(
            whole.title,
            [
                f"<h1>{escape(whole.title)}</h1>",
                f'<div class="note">{escape(whole.note)}</div>',
                *(table.html() for table in whole.tables),
                f'<img alt="torques of each joint over time" src="data:image/png;base64,{data}">',
            ],
        )

    def plot(self) -> Any:
        """Return the figures ``torque``, measured and predicted, and ``parameters``, online."""
        from ..plots.figures import parameter_figure, prediction_figure
        from ..plots.style import (
            RC,
            matplotlib,  # here, because matplotlib is slow to import
        )

        windows = self.windows
        title = f"{self.described.name}, {Path(self.log.source).name}"
        estimates = {"described": self.described_parameters, "identified": self.before_split}
        predicted = {name: windows.tau - windows.residual(a) for name, a in estimates.items()}
        online = SimpleNamespace(
            title=title,
            law="identified online",
            adaptation="Estimator",
            t=np.array(list(self.online)),
            a_d=np.array([one.a for one in self.online.values()]),
            a_d_true=None,
            not_identified=(),
            kinematic_names=(),
            dynamic_names=self.estimator.names,
            marks=(),
        )
        with matplotlib.rc_context(RC):
            return SimpleNamespace(
                torque=prediction_figure(
                    title, self.described.slides, windows.t, windows.tau, predicted, self.split
                ),
                parameters=parameter_figure(online),
            )


@threadpool_limits.wrap(limits=1, user_api="blas")
def _online(
    estimator: Estimator, motion: MeasuredMotion, split: float
) -> dict[float, OnlineEstimate]:
    """Return estimates by their times [s]: some for a picture, and the last one before a split.

    Args:
        estimator: whose torques are those of the instant.
        motion: with N samples.
        split: time [s] from which on the motion is held out.
    """
    measured = [
        Measurement(t, q, v, tau=tau)
        for t, q, v, tau in zip(motion.t.tolist(), motion.q, motion.v, motion.tau, strict=True)
    ]
    stops = {*evenly(len(measured), _TIMES), np.searchsorted(motion.t, split) - 1}
    state = estimator.init(measured[0])
    last = None
    found = {}
    for k in watched(range(1, len(measured)), None, "online"):
        state = estimator.step(state, measured[k])
        if k in stops:
            found[state.t] = last = estimator.estimate(state, last)
    return found
