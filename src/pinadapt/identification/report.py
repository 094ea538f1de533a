"""The report of an identification: its record, of which text, page and ``summary.json`` consist."""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Mapping, Sequence
from dataclasses import asdict, is_dataclass
from html import escape
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from .._output import Sheet, Table, html_page, whole_file, write_text
from .._version import __version__
from ..exceptions import InputError, ParameterError
from ..information.information import Information, identifiable, known_to
from ..information.measured_motion import CUTOFF
from ..information.payload import PayloadEstimate
from ..models.basis import base_parameters
from ..robot.robot import Robot
from ..tuning.unknowns import Unknown, nominal_dynamics
from .fits import windows_of
from .identified_model import IdentifiedModel, rms

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
_SINGULAR = 1e-10  # share of the largest singular value that least squares leave out; rounding


def verdict(found: IdentifiedModel) -> str:
    """Return the result in one line."""
    if found.check is not None and not found.check.fits:
        return f"NOT TO BE TRUSTED: {found.check.verdict}"
    if not found.dynamic.names:
        return f"error of held-out positions: {_of_positions(found)} (rms)."
    errors = found.torque_errors
    before, after = rms(errors.described_held_out), rms(errors.learned_held_out)
    gain = errors.gain or 0.0
    words = f"error of held-out torques: {before:.3g} -> {after:.3g} {unit_of(found)} (rms), "
    words += f"{gain:.3g} times less"
    if (off := position_doubt(found)) is not None:
        return f"{words}. {off}"
    if gain >= _HARDLY:
        return f"{words}."
    if max(before, after) < _RIGHT * rms(errors.size):
        return f"{words}. The description was already correct to 0.1 % of the torques."
    if gain < 1.0:
        return f"{words}: WORSE. The estimate from the first part does not predict the last."
    return f"{words}, hardly better than the description. Are these the joints' torques?"


def position_doubt(found: IdentifiedModel) -> str | None:
    """Return why a log seems to be that of another robot by its positions, None if it does not."""
    positions = found.position_errors
    if positions is None or not found.described.task.positions:
        return None
    off = float(np.linalg.norm(positions.learned_held_out))
    if off < _OFF * found.described.reach:
        return None
    return (
        "Is this the log of another robot, frame or base, or are its joints in another order? "
        f"The positions are {1e3 * off:.3g} mm off even as identified."
    )


def unit_of(found: IdentifiedModel) -> str:
    """Return the unit of the torques."""
    return "N m or N" if any(found.described.slides.values()) else "N m"


def _of_positions(found: IdentifiedModel) -> str:
    """Return the errors of held-out positions before and after, in words."""
    errors = found.position_errors
    assert errors is not None  # else no translation is unknown
    before, after = rms(errors.described_held_out), rms(errors.learned_held_out)
    return f"{1e3 * before:.3g} -> {1e3 * after:.3g} mm"


def title(found: IdentifiedModel) -> str:
    """Return what was identified from which logs, and on which it was tested."""
    logs = [name for name in found.log.source.split(", ") if name not in found.tested]
    words = f"{found.described.name}, identified from {', '.join(logs)}"
    return f"{words}, tested on {', '.join(found.tested)}" if found.tested else words


def sheet(found: IdentifiedModel, compared: Mapping[str, Robot] | None = None) -> Sheet:
    """Return the whole report, with the held-out errors of other models by name.

    Raises:
        ParameterError: a compared robot has other joints.
    """
    tables = [Table(_overview(found))]
    if found.check is not None:
        tables.append(found.check.table())
    if found.dynamic.names:
        tables.append(_torque_table(found, compared or {}))
    if found.effects is not None:
        rows = [
            (one.words, f"{one.share:.1%}", f"+- {one.deviation:.1%}")
            for one in found.effects.gains
        ]
        what = "effect of the joints, beside viscous and Coulomb friction"
        rows = rows or [("none lowers the error in cross-validation", "", "")]
        tables.append(Table(rows, (what, "lowers the squared error by", "")))
    if (load := payload_of(found)) is not None:
        tables += load.tables()
    units = found.parameters().units
    start = found.estimator.controller.kinematics.initial
    for part, before in ((found.kinematic, start), (found.dynamic, found.described_parameters)):
        if part.names:
            tables.append(_parameter_table(part, before, units))
    return Sheet(title(found), tables, verdict(found))


def _overview(found: IdentifiedModel) -> list[tuple[str, str]]:
    """Return the input, how it was processed, and how many combinations are identifiable."""
    log, online = found.log, found.online
    velocities = "as measured"
    if found.smoothed:
        reason = "none" if log.v is None else "those of the log disagree with the positions"
        velocities = f"{reason}; computed from the positions (zero phase, {CUTOFF:g} Hz)"
    rows = [
        ("log", f"{len(log.t)} samples, {log.duration:.4g} s, every {1e3 * log.period:.4g} ms"),
        ("velocities", velocities),
        ("torques", "held until the next sample" if log.held else "measured at each sample"),
        ("averaged over", f"{len(found.windows.t)} windows of {found.windows.length:.2g} s"),
        ("held out", ", ".join(found.tested) or f"from {found.split:.4g} s on"),
    ]
    if log.v is None:
        rows.append(("online", f"velocities from a causal low pass, {CUTOFF:g} Hz"))
    if online.refused:
        rows.append(("refused online", f"{online.refused} samples, the first {online.reason}"))
    for name, part in (("kinematic", found.kinematic), ("dynamic", found.dynamic)):
        if part.names:
            rows.append((f"{name} parameters", identifiable(part)))
    if found.check is not None:
        rows += [("note", note) for note in found.check.notes]
    if found.position_errors is not None:
        rows.append(("held-out positions", f"{_of_positions(found)} (rms)"))
    return rows


def _torque_table(found: IdentifiedModel, compared: Mapping[str, Robot]) -> Table:
    """Return held-out errors of the torques, one row for each joint."""
    errors, (plain, weighted) = found.torque_errors, least_squares_errors(found)
    columns = {
        "torque": errors.size,
        "described": errors.described_held_out,
        "OLS": plain,
        "WLS": weighted,
        **{name: _error_of(found, robot) for name, robot in compared.items()},
        "identified": errors.learned_held_out,
        "online": found.online_held_out,
    }
    names = [*found.described.joint_names, f"all, rms, {unit_of(found)}"]
    values = np.array([[*part, rms(part)] for part in columns.values()]).T
    rows = [
        (name, *(f"{value:.3g}" for value in row), "")
        for name, row in zip(names, values, strict=True)
    ]
    return Table(rows, ("error of held-out torques", *columns, ""))


def least_squares_errors(found: IdentifiedModel) -> tuple[np.ndarray, np.ndarray]:
    """Return the held-out errors (n) of base parameters by ordinary and weighted least squares.

    They have the same effects of the joints, no prior, and need not be physical: what is usual in
    the literature.
    """
    dynamics = found.estimator.controller.dynamics
    chosen = base_parameters(dynamics, found.described).chosen
    first = found.windows.between(-np.inf, found.split)
    last = found.windows.between(found.split, np.inf)
    W, errors = first.W[:, :, chosen], []
    noise = np.ones(W.shape[1])
    for _ in range(2):
        A = (W / noise[:, None]).reshape(-1, len(chosen))
        a = np.linalg.lstsq(A, (first.y / noise).ravel(), rcond=_SINGULAR)[0]
        errors.append(_columns_rms(last.y - last.W[:, :, chosen] @ a))
        noise = np.maximum(_columns_rms(first.y - W @ a), np.finfo(float).tiny)
    return errors[0], errors[1]


def _error_of(found: IdentifiedModel, robot: Robot) -> np.ndarray:
    """Return the held-out errors (n) of the torques that another robot predicts.

    Raises:
        ParameterError: it has other joints.
    """
    if robot.joint_names != found.described.joint_names:
        raise ParameterError(
            f"its joints are {list(robot.joint_names)}, those of the log "
            f"{list(found.described.joint_names)}.",
            where=f"compared model {robot.name}",
        )
    dynamics = nominal_dynamics(robot, Unknown(bodies="none", friction=False, armature=False), ())
    windows = windows_of(found.motion, dynamics, found.log.period, held=found.log.held)
    return _columns_rms(windows.between(found.split, np.inf).y)


def _columns_rms(residual: np.ndarray) -> np.ndarray:
    return np.asarray(np.sqrt(np.mean(np.square(residual), axis=0)))


def payload_of(found: IdentifiedModel) -> PayloadEstimate | None:
    """Return the load, or None where the last body was not among the parameters."""
    try:
        return found.payload()
    except ParameterError:
        return None


def _parameter_table(part: Information, before: np.ndarray, units: Mapping[str, str]) -> Table:
    """Return the identifiable parameters, and how many others there are."""
    identified = np.isfinite(part.deviations)
    rows = [
        (name, f"{first:.4g}", f"{value:.4g}", known_to(deviation), units.get(name, ""))
        for name, first, value, deviation, shown in zip(
            part.names, before, part.estimate, part.deviations, identified, strict=True
        )
        if shown
    ]
    if not identified.all():
        others = f"{np.count_nonzero(~identified)} others"
        rows.append((others, "", "", "", "only combinations of them are identifiable"))
    return Table(rows, ("parameter", "described", "learned", "known to", "unit"))


def summary(found: IdentifiedModel) -> dict[str, Any]:
    """Return the record of ``summary.json``; None stands for what is not finite."""
    effects, errors = found.effects, found.torque_errors if found.dynamic.names else None
    record = {
        "verdict": verdict(found),
        "log": found.log.source,
        "robot": found.described.name,
        "joint_names": found.described.joint_names,
        "samples": len(found.log.t),
        "duration": found.log.duration,
        "period": found.log.period,
        "velocities_from_positions": found.smoothed,
        "windows": len(found.windows.t),
        "held_out_from": found.split,
        "tested": found.tested,
        "check": None if found.check is None else found.check.summary(),
        "torque": None if errors is None else errors.summary(),
        "torque_online_held_out": found.online_held_out,
        "position": None if found.position_errors is None else found.position_errors.summary(),
        "dynamic_identifiable": found.dynamic.rank,
        "kinematic_identifiable": found.kinematic.rank,
        "dynamic": _values(found.dynamic),
        "kinematic": _values(found.kinematic),
        "effects": None if effects is None else {"unknown": effects.words, "gains": effects.gains},
        "payload": payload_of(found),
        "refused_online": found.online.refused,
        "version": __version__,
    }
    return dict(plain(record))


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


def _values(part: Information) -> list[dict[str, Any]]:
    columns = zip(part.names, part.estimate.tolist(), part.deviations.tolist(), strict=True)
    return [{"name": name, "value": value, "known_to": known} for name, value, known in columns]


def save(found: IdentifiedModel, folder: Path, *, mjcf: bool = False) -> None:
    """Write arrays, numbers and the identified robot into a folder, each file atomically.

    Raises:
        ParameterError: files of the robot that could not be written; all others are.
    """
    arrays: dict[str, Any] = {
        "t": found.online.t,
        "a_k": found.online.a_k,
        "a_d": found.online.a_d,
        "dynamic": found.dynamic.estimate,
        "dynamic_information": found.dynamic.H,
        "kinematic": found.kinematic.estimate,
        "kinematic_information": found.kinematic.H,
        "window_t": found.windows.t,
        "window_tau": found.windows.tau,
        "window_error_described": found.windows.residual(found.described_parameters),
        "window_error_learned": found.windows.residual(found.dynamic.estimate),
    }
    with whole_file(folder / "estimates.npz") as file:
        np.savez_compressed(file, **arrays)
    found.parameters().save(folder / "learned.json")
    about = f"How {Path(found.log.source).name} was read."
    write_text(folder / "intake.toml", found.intake.text([about]))
    write_text(folder / "summary.json", json.dumps(summary(found), indent=2) + "\n")
    missing = []
    for name in ("learned.urdf", "learned.xml")[: 1 + mjcf]:
        try:
            found.robot.save(folder / name)
        except InputError as reason:
            missing.append(f"{name}: {reason}")
    if missing:
        raise ParameterError("; ".join(missing), where="not written")


def page(found: IdentifiedModel, compared: Mapping[str, Robot] | None = None) -> str:
    """Return the report as a web page with pictures, without scripts and external resources.

    Args:
        found: the identification.
        compared: other models of the same chain by name, whose held-out errors are shown.

    Raises:
        ParameterError: a compared robot has other joints.
    """
    whole = sheet(found, compared)
    torque, friction = pictures_of(found).torque, _friction(found)
    return html_page(
        whole.title,
        [
            f"<h1>{escape(whole.title)}</h1>",
            f'<div class="note">{escape(whole.note)}</div>',
            *(table.html() for table in whole.tables),
            "<p>OLS, WLS: ordinary and weighted least squares on base parameters.</p>",
            "<h2>Torques</h2>",
            _image(torque, "torques of each joint over time"),
            "<h2>Friction: torques without those of the identified bodies, over the velocity</h2>",
            _image(friction, "torque of each joint's friction over its velocity"),
        ],
    )


def _image(picture: Picture, words: str) -> str:
    data = b64encode(picture.png(dpi=100)).decode()
    return f'<img alt="{escape(words)}" src="data:image/png;base64,{data}">'


def _friction(found: IdentifiedModel) -> Picture:
    """Return a picture of the torque that bodies do not explain, over the velocity."""
    from ..plots.figures import friction_figure
    from ..plots.style import RC, matplotlib  # here, because matplotlib is slow to import

    windows, motion, a = found.windows, found.motion, found.dynamic.estimate
    size = found.estimator.controller.dynamics.inertial.size
    seen = windows.y - windows.W[:, :, :size] @ a[:size]
    model = windows.W[:, :, size:] @ a[size:]
    v = np.column_stack([np.interp(windows.t, motion.t, part) for part in motion.v.T])
    with matplotlib.rc_context(RC):
        return friction_figure(found.described.slides, v, seen, model)


class Pictures(NamedTuple):
    """The pictures of an identification; in Jupyter each shows itself.

    Attributes:
        torque: of each joint as measured, and as predicted by the description and by the estimate
            from the log before the held-out part.
        parameters: the online estimates in time; dashed: the estimates from the whole log.
    """

    torque: Picture
    parameters: Picture


def pictures_of(found: IdentifiedModel) -> Pictures:
    """Draw both pictures."""
    from ..plots.figures import parameter_figure, prediction_figure
    from ..plots.style import (
        RC,
        matplotlib,  # here, because matplotlib is slow to import
    )

    windows, title = found.windows, f"{found.described.name}, {Path(found.log.source).name}"
    before, after = (windows.residual(a) for a in (found.described_parameters, found.before_split))
    online = SimpleNamespace(
        title=title,
        law="identified online",
        adaptation=found.estimator.controller.adaptation_d.name,
        t=found.online.t,
        a_k=found.online.a_k,
        a_d=found.online.a_d,
        a_k_true=found.kinematic.estimate,
        a_d_true=found.dynamic.estimate,
        not_identified=(),
        kinematic_names=found.kinematic.names,
        dynamic_names=found.dynamic.names,
        marks=(),
        diverged=None,
        interrupted=None,
    )
    with matplotlib.rc_context(RC):
        torque = prediction_figure(
            title,
            found.described.slides,
            windows.t,
            windows.tau,
            {"described": windows.tau - before, "identified": windows.tau - after},
            found.split,
        )
        return Pictures(torque, parameter_figure(online, "dashed: whole log"))


def draw(found: IdentifiedModel, folder: Path) -> list[Path]:
    """Write ``torque.png`` and ``parameters.png``; return their paths."""
    paths = []
    for name, picture in pictures_of(found)._asdict().items():
        paths.append(folder / f"{name}.png")
        with whole_file(paths[-1]) as file:
            file.write(picture.png(dpi=130))
    return paths
