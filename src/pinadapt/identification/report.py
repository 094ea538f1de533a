"""The report of an identification: verdict, tables, ``summary.json``, files and pictures."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from .._output import Sheet, Table, whole_file, write_text
from .._version import __version__
from ..exceptions import InputError, ParameterError
from ..information.information import Information, identifiable, known_to
from ..information.measured_motion import CUTOFF
from ..information.payload import PayloadEstimate, explanation_table
from ..robot.motors import Gravity
from .identified_model import IdentifiedModel, rms
from .selection import ChosenEffects

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
_HARDLY = 2.0  # gain up to which the estimate is hardly better than the description
_RIGHT = 1e-3  # share of the torques up to which a description is correct
_OFF = 0.02  # of the reach, error of the identified positions
_LEFT = 0.05  # share of the torques that the estimate does not explain
_DIFFERENCE = "of the difference between log and description"
_GRAVITY = 0.7  # share of the error left when gravity is added to a log without it


def verdict(found: IdentifiedModel) -> str:
    """Return the result in one line."""
    if found.check is not None and not found.check.fits:
        return f"NOT TO BE TRUSTED: {found.check.verdict}"
    if not found.dynamic.names:
        errors = found.position_errors
        assert errors is not None  # else nothing was unknown
        before, after = rms(errors.described_held_out), rms(errors.learned_held_out)
        return f"error of held-out positions: {1e3 * before:.3g} -> {1e3 * after:.3g} mm (rms)."
    errors = found.torque_errors
    before, after, gain = (
        rms(errors.described_held_out),
        rms(errors.learned_held_out),
        errors.gain or 0.0,
    )
    words = f"error of held-out torques: {before:.3g} -> {after:.3g} {unit_of(found)} (rms), "
    words += f"{gain:.3g} times less"
    if (doubt := of_another_robot(found)) is not None:
        return f"{words}. {doubt}"
    if gain >= _HARDLY:
        return words + "."
    if max(before, after) < _RIGHT * rms(errors.size):
        return f"{words}. The description was already correct to 0.1 % of the torques."
    if leaves_gravity_out(found):
        return (
            f"{words}. These torques seem to lack gravity; if the arm compensates it, set "
            'compensated = "nominal".'
        )
    if gain < 1.0:
        return f"{words}: WORSE. The estimate from the first part does not predict the last."
    return f"{words}, hardly better than the description. Are these the joints' torques?"


def of_another_robot(found: IdentifiedModel) -> str | None:
    """Return why a log seems to be that of another robot, None where it does not.

    Either the identified model is off the measured positions by more than 2 % of the reach, or the
    description explains nothing of the torques and the estimate leaves 5 % of them.
    """
    reasons, positions = [], found.position_errors
    if positions is not None and found.described.task.positions:
        off = float(np.linalg.norm(positions.learned_held_out))
        if off > _OFF * found.described.reach:
            reasons.append(f"the positions are {1e3 * off:.3g} mm off even as identified")
    errors = found.torque_errors
    nothing = rms(errors.described) > rms(errors.size)
    if nothing and rms(errors.learned_held_out) > _LEFT * rms(errors.size):
        share = rms(errors.learned_held_out) / rms(errors.size)
        if not leaves_gravity_out(found):
            reasons.append(
                "the description explains nothing of the torques, and the estimate leaves "
                f"{share:.0%} of them"
            )
    if not reasons:
        return None
    return (
        f"Is this the log of another robot, frame or base, or are its joints in another order? "
        f"{'; '.join(reasons).capitalize()}."
    )


def leaves_gravity_out(found: IdentifiedModel) -> bool:
    """Return whether the description predicts the torques much better with gravity added."""
    windows, robot = found.windows, found.described
    gravity, q = Gravity(robot), found.log.configurations(robot)
    near = np.searchsorted(found.log.t, windows.t).clip(0, len(found.log.t) - 1)
    added = np.array(
        [gravity(q[k]) if np.isfinite(q[k]).all() else 0.0 * windows.y[0] for k in near]
    )
    left = windows.residual(found.described_parameters)
    return bool(rms(left + added) < _GRAVITY * rms(left))


def sheet(found: IdentifiedModel) -> Sheet:
    """Return the whole report."""
    rows = overview(found)
    tables = [Table(rows)]
    if found.check is not None:
        tables = [Table(rows), found.check.table()]
    if found.dynamic.names:
        tables.append(_torque_table(found))
    if found.effects is not None:
        tables.append(effect_table(found.effects))
    if (load := payload_of(found)) is not None:
        tables += load_tables(load)
    return Sheet(title(found), [*tables, *parameter_tables(found)], verdict(found))


def title(found: IdentifiedModel, *, folders: bool = True) -> str:
    """Return what was identified from which logs, and on which it was tested."""
    logs = found.log.source.split(", ")
    parts = [[name for name in logs if name not in found.tested], list(found.tested)]
    learned, tested = (
        ", ".join(name if folders else Path(name).name for name in part) for part in parts
    )
    words = f"{found.described.name}, identified from {learned}"
    return f"{words}, tested on {tested}" if tested else words


def unit_of(found: IdentifiedModel) -> str:
    """Return the unit of the torques."""
    return "N m or N" if any(found.described.slides.values()) else "N m"


def overview(found: IdentifiedModel) -> list[tuple[str, str]]:
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
    if found.log.v is None:
        rows.append(("online", f"velocities from a causal low pass, {CUTOFF:g} Hz"))
    if online.refused:
        rows.append(("refused online", f"{online.refused} samples, the first {online.reason}"))
    for name, part in (("kinematic", found.kinematic), ("dynamic", found.dynamic)):
        if part.names:
            rows.append((f"{name} parameters", identifiable(part)))
    if found.check is not None:
        rows += [("note", note) for note in found.check.notes]
    if (errors := found.position_errors) is not None:
        before, after = rms(errors.described_held_out), rms(errors.learned_held_out)
        words = f"{1e3 * before:.4g} -> {1e3 * after:.4g} mm (rms)"
        rows.append(("held-out positions", words))
    return rows


def _torque_table(found: IdentifiedModel) -> Table:
    """Return errors of the torque, one row for each joint."""
    errors, online = found.torque_errors, found.online_held_out
    header = (
        "joint",
        "torque",
        "error: described",
        "learned",
        "held out: described",
        "learned",
        "online",
        "times less",
    )
    columns = (
        errors.size,
        errors.described,
        errors.learned,
        errors.described_held_out,
        errors.learned_held_out,
        online,
    )
    rows = [
        (name, *(f"{values[j]:.3g}" for values in columns), f"{columns[3][j] / columns[4][j]:.3g}")
        for j, name in enumerate(found.described.joint_names)
    ]
    gain = "-" if errors.gain is None else f"{errors.gain:.3g}"
    rows.append((f"rms, {unit_of(found)}", *(f"{rms(values):.3g}" for values in columns), gain))
    return Table(rows, header)


def effect_table(effects: ChosenEffects) -> Table:
    """Return what each effect of the joints gained."""
    rows = [(gain.words, f"{gain.share:.1%}", f"+- {gain.deviation:.1%}") for gain in effects.gains]
    what = "effect of the joints, beside viscous and Coulomb friction"
    header = what, "lowers the squared error by", ""
    return Table(rows or [("none lowers the error in cross-validation", "", "")], header)


def payload_of(found: IdentifiedModel) -> PayloadEstimate | None:
    """Return the load, or None where the last body was not among the parameters."""
    try:
        return found.payload()
    except ParameterError:
        return None


def load_tables(load: PayloadEstimate) -> list[Table]:
    """Return a table of a load, and one of what explains the torques."""
    rows = [*load.rows(), ("explains", f"{load.explained:.2%}", "", _DIFFERENCE)]
    if not load.certain:
        rows.append(
            ("A LOAD IS NOT CERTAIN", "", "", f"more probable: {load.explanations[0].words}")
        )
    tables = [Table(rows, ("load", "value", "known to", "unit"))]
    return [*tables, *([explanation_table(load.explanations)] if load.explanations else [])]


def parameter_tables(found: IdentifiedModel) -> list[Table]:
    """Return the identified translations, and the dynamic parameters."""
    units = found.parameters().units
    start = found.estimator.controller.kinematics.initial
    parts = ((found.kinematic, start), (found.dynamic, found.described_parameters))
    return [_parameter_table(part, before, units) for part, before in parts if part.names]


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
        rows.append(
            (
                f"{np.count_nonzero(~identified)} others",
                "",
                "",
                "",
                "only combinations of them are identifiable",
            )
        )
    return Table(rows, ("parameter", "described", "learned", "known to", "unit"))


def summary(found: IdentifiedModel) -> dict[str, Any]:
    """Return the numbers of ``summary.json``; None stands for what is not finite."""
    load, positions = payload_of(found), found.position_errors
    held_out = found.online_held_out
    return {
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
        "tested": list(found.tested),
        "check": None if found.check is None else found.check.summary(),
        "torque": found.torque_errors.summary() if found.dynamic.names else None,
        "torque_online_held_out": held_out.tolist() if np.isfinite(held_out).all() else None,
        "position": None if positions is None else positions.summary(),
        "dynamic_identifiable": found.dynamic.rank,
        "kinematic_identifiable": found.kinematic.rank,
        "dynamic": _values(found.dynamic),
        "kinematic": _values(found.kinematic),
        "effects": None if found.effects is None else _effects(found.effects),
        "payload": None if load is None else _load_summary(load),
        "refused_online": found.online.refused,
        "version": __version__,
    }


def _effects(effects: ChosenEffects) -> dict[str, Any]:
    """Return the chosen effects, and the friction's shape by joint."""
    friction = effects.friction
    return {
        "unknown": list(effects.words),
        "gains": [
            {"words": gain.words, "share": gain.share, "known_to": gain.deviation}
            for gain in effects.gains
        ],
        "threshold": friction.threshold.tolist(),
        "breakaway": friction.breakaway.tolist(),
        "fading": friction.fading.tolist(),
    }


def _values(part: Information) -> list[dict[str, Any]]:
    return [
        {"name": name, "value": value, "known_to": known if np.isfinite(known) else None}
        for name, value, known in zip(
            part.names, part.estimate.tolist(), part.deviations.tolist(), strict=True
        )
    ]


def _load_summary(load: PayloadEstimate) -> dict[str, Any]:
    known = np.array([load.mass_known_to, *load.com_known_to, *load.inertia_known_to])
    values = np.array([load.mass, *load.com, *load.inertia])
    finite = [
        value if np.isfinite(value) else None for value in (*values.tolist(), *known.tolist())
    ]
    return {
        "mass": finite[0],
        "com": finite[1:4],
        "inertia": finite[4:10],
        "mass_known_to": finite[10],
        "com_known_to": finite[11:14],
        "inertia_known_to": finite[14:],
        "explained": load.explained,
        "certain": load.certain,
        "explanations": [
            {
                "words": one.words,
                "probability": one.probability,
                "explained": one.explained,
                "mass": one.mass if one.loaded else None,
                "mass_known_to": one.mass_known_to if one.loaded else None,
            }
            for one in load.explanations
        ],
    }


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
        not_excited=(),
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
