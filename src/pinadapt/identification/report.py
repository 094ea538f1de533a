"""The report of an identification: its record, of which text, page and ``summary.json`` consist."""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, is_dataclass
from html import escape
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from .._output import Sheet, Table, html_page, whole_file, write_text
from .._version import __version__
from ..exceptions import InputError, ParameterError
from ..information.information import identifiable, known_to
from ..information.measured_motion import CUTOFF
from ..information.payload import PayloadEstimate
from ..information.tracker import CERTAIN
from ..robot.robot import Robot
from ..tuning.unknowns import Unknown, nominal_dynamics
from .fits import Windows, columns_rms
from .identified_model import Errors, IdentifiedModel, rms

if TYPE_CHECKING:
    from ..plots.style import Picture

FILES = (
    "estimates.npz",
    "torque.png",
    "parameters.png",
    "learned.json",
    "learned.urdf",
    "intake.toml",
    "report.html",
    "learned.xml",
    "summary.json",
)
# Gain up to which the estimate is hardly better than the description, and the share of the torques
# up to which a description is correct: half or twice as much changes words for borderline logs.
_HARDLY, _RIGHT = 2.0, 1e-3
_OFF = 0.02  # of the reach, error of positions from which the robot is another one; half: the same


def _change(errors: Errors, scale: float = 1.0) -> str:
    """Return the errors of the held-out part before and after, in words."""
    both = errors.described_held_out, errors.learned_held_out
    return " -> ".join(f"{scale * rms(part):.3g}" for part in both)


def _parameter_table(parameters: Sequence[Mapping[str, Any]]) -> Table:
    """Return the identifiable parameters, and how many others there are."""
    shown = [one for one in parameters if np.isfinite(one["known_to"])]
    rows = [
        (
            str(one["name"]),
            *(f"{one[kind]:.4g}" for kind in ("described", "value")),
            known_to(one["known_to"]),
            str(one["unit"]),
        )
        for one in shown
    ]
    if len(shown) < len(parameters):
        others = f"{len(parameters) - len(shown)} others"
        rows.append((others, "", "", "", "only combinations of them are identifiable"))
    return Table(rows, ("parameter", "described", "learned", "known to", "unit"))


def plain(value: Any) -> Any:
    """Return a value of what JSON has: None for what is not finite, records as their fields."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if is_dataclass(value) and not isinstance(value, type):
        value = asdict(value)
    if hasattr(value, "_asdict"):
        value = value._asdict()
    if isinstance(value, Mapping):
        return {key: plain(part) for key, part in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [plain(part) for part in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value


class Pictures(NamedTuple):
    """The pictures of an identification; in Jupyter each shows itself.

    Attributes:
        torque: of each joint as measured, and as predicted by the description and by the estimate
            from the log before the held-out part.
        parameters: the online estimates in time; dashed: the estimates from the whole log.
    """

    torque: Picture
    parameters: Picture


@dataclass(frozen=True, eq=False, repr=False)
class Identification(IdentifiedModel):
    """A robot identified from a log; ``print`` shows a report.

    The estimates and their errors are those of ``IdentifiedModel``.
    """

    @property
    def trusted(self) -> bool:
        """Whether the log can be one of the described robot, by its torques and positions."""
        fits = self.check is None or self.check.fits
        return fits and (not self.dynamic.names or self._position_doubt is None)

    @property
    def verdict(self) -> str:
        """The result in one line."""
        if self.check is not None and not self.check.fits:
            return f"NOT TO BE TRUSTED: {self.check.verdict}"
        if self.position_errors is not None and not self.dynamic.names:
            return f"error of held-out positions: {_change(self.position_errors, 1e3)} mm (rms)."
        errors = self.torque_errors
        gain, words = errors.gain or 0.0, f"error of held-out torques: {_change(errors)} "
        words += f"{self._unit} (rms), {gain:.3g} times less"
        if (off := self._position_doubt) is not None:
            return f"{words}. {off}"
        if gain >= _HARDLY:
            return f"{words}."
        if np.linalg.norm(errors.described_held_out) < _RIGHT * np.linalg.norm(errors.size):
            return f"{words}. The description was already correct to 0.1 % of the torques."
        if gain < 1.0:
            return f"{words}: WORSE. The estimate from the first part does not predict the last."
        return f"{words}, hardly better than the description. Are these the joints' torques?"

    @property
    def _position_doubt(self) -> str | None:
        """Why a log seems to be that of another robot by its positions, None if it does not."""
        positions = self.position_errors
        if positions is None or not self.described.task.positions:
            return None
        off = float(np.linalg.norm(positions.learned_held_out))
        if off < _OFF * self.described.reach:
            return None
        return (
            "Is this the log of another robot, frame or base, or are its joints in another order? "
            f"The positions are {1e3 * off:.3g} mm off even as identified."
        )

    @property
    def _unit(self) -> str:
        """Unit of the torques."""
        return "N m or N" if any(self.described.slides.values()) else "N m"

    @property
    def _record(self) -> dict[str, Any]:
        """What there is to say of an identification: text and page consist of it too."""
        try:
            load: PayloadEstimate | None = self.payload()
        except ParameterError:  # the last body was not among the parameters
            load = None
        log, effects, units = self.log, self.effects, self.parameters().units
        start = self.estimator.controller.kinematics.initial
        signals = np.hstack([log.q, log.tau, *([] if log.v is None else [log.v])])
        parts = {"dynamic": (self.dynamic, self.described_parameters)}
        parts["kinematic"] = self.kinematic, start
        columns = ("name", "described", "value", "known_to", "unit")
        tables = {
            kind: [
                dict(zip(columns, (*each, units.get(each[0], "")), strict=True))
                for each in zip(
                    part.names, before.tolist(), part.estimate.tolist(), part.deviations.tolist(),
                    strict=True,
                )
            ]
            for kind, (part, before) in parts.items()
        }  # fmt: skip
        return {
            "verdict": self.verdict,
            "log": log.source,
            "robot": self.described.name,
            "joint_names": self.described.joint_names,
            "samples": len(log.t),
            "left_out": int(np.count_nonzero(~np.isfinite(signals).all(axis=1))),
            "duration": log.duration,
            "period": log.period,
            "velocities_from_positions": self.motion.smoothed,
            "windows": len(self.windows.t),
            "held_out_from": self.split,
            "tested": self.tested,
            "check": None if self.check is None else self.check.summary(),
            "torque": self.torque_errors if self.dynamic.names else None,
            "torque_online_held_out": self.online_held_out,
            "torque_late": self.late if self.dynamic.names else None,
            "position": self.position_errors,
            "dynamic_identifiable": self.dynamic.rank,
            "kinematic_identifiable": self.kinematic.rank,
            **tables,
            "effects": None
            if effects is None
            else {"unknown": effects.words, "gains": effects.gains},
            "payload": load,
            "version": __version__,
        }

    def _sheet(self, compared: Mapping[str, Robot] | None = None) -> Sheet:
        """Return the whole report, with the held-out errors of other models by name.

        Raises:
            ParameterError: a compared robot has other joints.
        """
        of, log = self._record, self.log
        velocities = "as measured"
        if self.motion.smoothed:
            reason = "none" if log.v is None else "those of the log disagree with the positions"
            velocities = f"{reason}; computed from the positions (zero phase, {CUTOFF:g} Hz)"
        period, count = f"every {1e3 * log.period:.4g} ms", of["left_out"]
        rows = [
            ("log", f"{of['samples']} samples, {log.duration:.4g} s, {period}"),
            ("left out", f"{count} samples that are not finite"),
            ("velocities", velocities),
            ("torques", "held until the next sample" if log.held else "measured at each sample"),
            ("averaged over", f"{of['windows']} windows of {self.windows.length:.2g} s"),
            ("held out", ", ".join(self.tested) or f"from {self.split:.4g} s on"),
        ]
        for name, part in (("kinematic", self.kinematic), ("dynamic", self.dynamic)):
            if part.names:
                rows.append((f"{name} parameters", identifiable(part)))
        rows += [("note", note) for note in self._notes()]
        if self.position_errors is not None:
            rows.append(("held-out positions", f"{_change(self.position_errors, 1e3)} mm (rms)"))
        tables = [Table(rows)]
        if self.check is not None:
            tables.append(self.check.table())
        if self.dynamic.names:
            tables.append(self._torque_table(compared or {}))
        if of["effects"] is not None:
            gains = [
                (one.words, f"{one.share:.1%}", f"+- {one.deviation:.1%}")
                for one in of["effects"]["gains"]
            ]
            what = "effect of the joints, beside viscous and Coulomb friction"
            gains = gains or [("none lowers the error in cross-validation", "", "")]
            tables.append(Table(gains, (what, "lowers the squared error by", "")))
        if of["payload"] is not None:
            tables.append(of["payload"].table())
        tables += [_parameter_table(of[kind]) for kind in ("kinematic", "dynamic") if of[kind]]
        logs = [name for name in log.source.split(", ") if name not in self.tested]
        tested = f", tested on {', '.join(self.tested)}" if self.tested else ""
        title = f"{self.described.name}, identified from {', '.join(logs)}{tested}"
        return Sheet(title, tables, of["verdict"])

    def _notes(self) -> Iterator[str]:
        """Yield what a user should look at: loads, another clock, bodies that became others."""
        if self.check is not None:
            yield from self.check.notes
        if not self.dynamic.names:
            return
        late, known = self.late
        if abs(late) > CERTAIN * known:
            yield (
                f"the torques seem to be {1e3 * late:.2g} +- {1e3 * known:.1g} ms later than the "
                "positions; part of this is learned as friction and inertia."
            )
        for name, before, after in zip(
            self.dynamic.names, self.described_parameters, self.dynamic.estimate, strict=True
        ):
            if name.endswith(".m") and not 0.5 < after / max(before, np.finfo(float).tiny) < 2.0:
                yield f"the mass of {name[:-2]} changed from {before:.3g} to {after:.3g} kg."

    def _torque_table(self, compared: Mapping[str, Robot]) -> Table:
        """Return held-out errors of the torques, one row for each joint.

        Raises:
            ParameterError: a compared robot has other joints.
        """
        errors, others = self.torque_errors, {}
        for name, robot in compared.items():
            if robot.joint_names != self.described.joint_names:
                raise ParameterError(
                    f"its joints are {list(robot.joint_names)}, those of the log "
                    f"{list(self.described.joint_names)}.",
                    where=f"compared model {robot.name}",
                )
            nothing = Unknown(bodies="none", friction=False, armature=False)
            dynamics = nominal_dynamics(robot, nothing, ())
            windows = Windows.of(self.motion, dynamics, self.log.period, held=self.log.held)
            others[name] = columns_rms(windows.between(self.split, np.inf).y)
        columns = {
            "torque": errors.size,
            "described": errors.described_held_out,
            **others,
            "identified": errors.learned_held_out,
            "online": self.online_held_out,
        }
        names = [*self.described.joint_names, f"all, rms, {self._unit}"]
        values = np.array([[*part, rms(part)] for part in columns.values()]).T
        rows = [
            (name, *(f"{value:.3g}" for value in row), "")
            for name, row in zip(names, values, strict=True)
        ]
        return Table(rows, ("error of held-out torques", *columns, ""))

    def report(self) -> str:
        """Return the estimates, their prediction errors, and what is not identifiable."""
        return str(self._sheet())

    __repr__ = report

    def _repr_html_(self) -> str:
        return self._sheet().html()

    def summary(self) -> dict[str, Any]:
        """Return the numbers of ``summary.json``; None stands for what is not finite."""
        return dict(plain(self._record))

    def save(self, folder: Path | str, *, mjcf: bool = False) -> None:
        """Write ``learned.urdf``, ``learned.json``, ``estimates.npz`` and ``summary.json``.

        Args:
            folder: that takes the files.
            mjcf: whether to write ``learned.xml`` too, see ``Robot.mjcf``.

        Raises:
            ParameterError: files of the robot that could not be written; the others are.
            OSError: they cannot be written.
        """
        folder = Path(folder)
        arrays: dict[str, Any] = {
            "t": self.online.t,
            "a_k": self.online.a_k,
            "a_d": self.online.a_d,
            "dynamic": self.dynamic.estimate,
            "dynamic_information": self.dynamic.H,
            "kinematic": self.kinematic.estimate,
            "kinematic_information": self.kinematic.H,
            "window_t": self.windows.t,
            "window_tau": self.windows.tau,
            "window_error_described": self.windows.residual(self.described_parameters),
            "window_error_learned": self.windows.residual(self.dynamic.estimate),
        }
        with whole_file(folder / "estimates.npz") as file:
            np.savez_compressed(file, **arrays)
        self.parameters().save(folder / "learned.json")
        about = f"How {Path(self.log.source).name} was read."
        write_text(folder / "intake.toml", self.intake.text([about]))
        write_text(folder / "summary.json", json.dumps(self.summary(), indent=2) + "\n")
        missing = []
        for name in ("learned.urdf", "learned.xml")[: 1 + mjcf]:
            try:
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
        whole = self._sheet(compared)
        data = b64encode(self.plot().torque.png(dpi=100)).decode()
        parts = [
            f"<h1>{escape(whole.title)}</h1>",
            f'<div class="note">{escape(whole.note)}</div>',
            *(table.html() for table in whole.tables),
            "<h2>Torques</h2>",
            f'<img alt="torques of each joint over time" src="data:image/png;base64,{data}">',
        ]
        return html_page(whole.title, parts)

    def plot(self, folder: Path | str | None = None) -> Any:
        """Draw measured and predicted torques, and the online estimates in time.

        Args:
            folder: into which to write ``torque.png`` and ``parameters.png``.

        Returns:
            The paths of the files; without a folder the two figures, which Jupyter displays.
        """
        from ..plots.figures import parameter_figure, prediction_figure
        from ..plots.style import (
            RC,
            matplotlib,  # here, because matplotlib is slow to import
        )

        windows, title = self.windows, f"{self.described.name}, {Path(self.log.source).name}"
        estimates = {"described": self.described_parameters, "identified": self.before_split}
        predicted = {name: windows.tau - windows.residual(a) for name, a in estimates.items()}
        online = SimpleNamespace(
            title=title,
            law="identified online",
            adaptation=self.estimator.controller.adaptation_d.name,
            t=self.online.t,
            a_k=self.online.a_k,
            a_d=self.online.a_d,
            a_k_true=self.kinematic.estimate,
            a_d_true=self.dynamic.estimate,
            not_identified=(),
            kinematic_names=self.kinematic.names,
            dynamic_names=self.dynamic.names,
            marks=(),
            diverged=None,
            interrupted=None,
        )
        slides = self.described.slides
        with matplotlib.rc_context(RC):
            torque = prediction_figure(title, slides, windows.t, windows.tau, predicted, self.split)
            both = Pictures(torque, parameter_figure(online, "dashed: whole log"))
        if folder is None:
            return both
        paths = []
        for name, picture in both._asdict().items():
            paths.append(Path(folder) / f"{name}.png")
            with whole_file(paths[-1]) as file:
                file.write(picture.png(dpi=130))
        return paths
