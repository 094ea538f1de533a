"""The report of an identification as one web page, without scripts and external resources."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .._output import Table, html_page
from ..description.chain import position_limits, velocity_limits
from ..exceptions import ParameterError
from ..information.information import Information
from ..information.measured_motion import MeasuredMotion
from ..models.basis import base_parameters
from ..models.joint_effects import KINDS
from ..robot.robot import Robot
from ..tuning.defaults import prior_covariance
from ..tuning.unknowns import Unknown, nominal_dynamics
from . import report
from .fits import windows_of
from .identified_model import IdentifiedModel, rms

if TYPE_CHECKING:
    from ..excitation.exciting_motion import ExcitingMotion

_BETTER = 1.1  # by which another model must predict better to be worth a warning
_SINGULAR = 1e-10  # share of the largest singular value that least squares leaves out
_DPI = 100


def page(
    found: IdentifiedModel,
    compared: Mapping[str, Robot] | None = None,
    motion: ExcitingMotion | None = None,
    command: str = "",
) -> str:
    """Return the whole page.

    Args:
        found: the identification.
        compared: other models of the same chain by name, such as a published one, with their
            friction; their errors stand beside the others.
        motion: one that excites the same parameters; the page says what it would identify in
            addition.
        command: that finds such a motion.

    Raises:
        ParameterError: a compared robot has other joints.
    """
    title = report.title(found, folders=False)
    parts = [f"<h1>{escape(title)}</h1>", *_warnings(found, compared or {})]
    if found.dynamic.names:
        parts += _torques(found, compared or {})
    parts += ["<h2>The log</h2>", Table(report.overview(found)).html()]
    if found.check is not None:
        parts += ["<h2>Do the torques fit the description?</h2>", found.check.table().html()]
    if found.effects is not None:
        parts += ["<h2>Effects of the joints</h2>", report.effect_table(found.effects).html()]
        parts.append(
            "<p>The squared error is that of blocks of time that were held out in turn, with the "
            "effects of the rows above.</p>"
        )
    if found.dynamic.names:
        parts += _left_open(found, motion, command)
    parts += _parameters(found)
    return html_page(title, parts)


def _boxes(kind: str, texts: Sequence[str]) -> list[str]:
    return [f'<div class="{kind}">{escape(text)}</div>' for text in texts]


def _warnings(found: IdentifiedModel, compared: Mapping[str, Robot]) -> Iterator[str]:
    """Yield the verdict, warnings first if there are any."""
    doubts, check = [], found.check
    verdict = report.verdict(found)
    doubtful = check is not None and not check.fits
    if found.dynamic.names:
        errors = found.torque_errors
        doubtful |= errors.gain is None or errors.gain < 1.0
        learned = rms(errors.learned_held_out)
        for name, held_out in _others(found, compared).items():
            if rms(held_out) * _BETTER < learned:
                doubts.append(
                    f"{name} predicts the held-out torques better: {rms(held_out):.3g} instead of "
                    f"{learned:.3g} {report.unit_of(found)} (rms)."
                )
    doubtful |= report.of_another_robot(found) is not None
    if (load := report.payload_of(found)) is not None and not load.certain:
        doubts.append(f"A load is not certain. More probable: {load.explanations[0].words}.")
    if found.online.refused:
        doubts.append(f"{found.online.refused} samples were refused, {found.online.reason}.")
    yield from _boxes("warning" if doubtful else "note", [verdict])
    yield from _boxes("warning", doubts)
    yield from _boxes("note", [] if check is None else list(check.notes))


def _others(found: IdentifiedModel, compared: Mapping[str, Robot]) -> dict[str, np.ndarray]:
    """Return the held-out errors (n) of least squares and of other models, by name."""
    plain, weighted = least_squares_errors(found)
    others = {"OLS": plain, "WLS": weighted}
    return others | {name: _rms(_errors(found, robot)) for name, robot in compared.items()}


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
        errors.append(_rms(last.y - last.W[:, :, chosen] @ a))
        noise = np.maximum(_rms(first.y - W @ a), np.finfo(float).tiny)
    return errors[0], errors[1]


def _errors(found: IdentifiedModel, robot: Robot) -> np.ndarray:
    """Return the errors (N, n) of the torques that a robot predicts in the held-out windows.

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
    return windows.between(found.split, np.inf).y


def _rms(residual: np.ndarray) -> np.ndarray:
    return np.asarray(np.sqrt(np.mean(np.square(residual), axis=0)))


def _torques(found: IdentifiedModel, compared: Mapping[str, Robot]) -> list[str]:
    """Return the table of errors and the pictures of the torques."""
    errors = found.torque_errors
    columns = {
        "torque": errors.size,
        "described": errors.described_held_out,
        **_others(found, compared),
        "identified": errors.learned_held_out,
        "identified online": found.online_held_out,
    }
    rows = [
        (name, *(f"{part[j]:.3g}" for part in columns.values()), "")
        for j, name in enumerate(found.described.joint_names)
    ]
    rows.append(("all, rms", *(f"{rms(part):.3g}" for part in columns.values()), ""))
    held_out = ", ".join(Path(name).name for name in found.tested) or f"after {found.split:.4g} s"
    return [
        "<h2>Errors of the torques that were held out</h2>",
        f"<p>{report.unit_of(found)}, root mean squares of averages over "
        f"{found.windows.length:.2g} s, held out: {escape(held_out)}. The torque is that of the "
        "whole log. OLS and WLS are ordinary and weighted least squares on base parameters with "
        "the same effects of the joints.</p>",
        Table(rows, ("joint", *columns, "")).html(),
        "<h2>Torques: measured, described, identified</h2>",
        _image(report.pictures_of(found).torque.png(_DPI), "torques of each joint over time"),
        "<h2>Friction</h2>",
        "<p>The measured torque minus that of the identified bodies, over the velocity, and what "
        "the identified effects of the joints are there. What is left between both is not "
        "explained.</p>",
        _image(_friction(found), "torque of each joint's friction over its velocity"),
    ]


def _image(png: bytes, words: str) -> str:
    return f'<img alt="{escape(words)}" src="data:image/png;base64,{b64encode(png).decode()}">'


def _friction(found: IdentifiedModel) -> bytes:
    """Return a picture of the torque that bodies do not explain, over the velocity."""
    from ..plots.figures import friction_figure
    from ..plots.style import RC, matplotlib  # here, because matplotlib is slow to import

    dynamics, windows = found.estimator.controller.dynamics, found.windows
    size, a = dynamics.inertial.size, found.dynamic.estimate
    seen = windows.y - windows.W[:, :, :size] @ a[:size]
    model = windows.W[:, :, size:] @ a[size:]
    motion = found.motion
    v = np.column_stack([np.interp(windows.t, motion.t, part) for part in motion.v.T])
    with matplotlib.rc_context(RC):
        return friction_figure(found.described.slides, v, seen, model).png(_DPI)


def _parameters(found: IdentifiedModel) -> list[str]:
    """Return the load and the parameters with their deviations."""
    parts = []
    if (load := report.payload_of(found)) is not None:
        parts += ["<h2>Load</h2>", *(table.html() for table in report.load_tables(load))]
        parts.append("<p>What the last body carries in addition to its description.</p>")
    parts.append("<h2>Parameters</h2>")
    parts += [table.html() for table in report.parameter_tables(found)]
    return parts


def _left_open(found: IdentifiedModel, motion: ExcitingMotion | None, command: str) -> list[str]:
    """Return how much of the initial uncertainty the log leaves, and which motion would help."""
    after = uncertainty_left(found)
    besides = None if motion is None else uncertainty_left(found, motion.excitation.dynamic)
    rows = []
    for j, name in enumerate(found.described.joint_names):
        shares = [
            _share(part, found.dynamic.names, name, joint)
            for joint in (False, True)
            for part in (after, besides)
            if part is not None
        ]
        rows.append((name, *_moved(found.described, found.motion, j), *shares, ""))
    new = ("and the motion",) if motion is not None else ()
    header = (
        "joint",
        "moved [rad or m]",
        "of its range",
        "fastest [/s]",
        "of its limit",
        *("body: after the log", *new),
        *("friction, rotor: after the log", *new),
        "",
    )
    parts = [
        "<h2>What the motion does not identify</h2>",
        "<p>The share of the initial uncertainty that is left, as the mean over the ten parameters "
        "of a body or the coefficients of a joint. Initially bodies are known to 30 % and "
        "coefficients to their typical size. Parameters that no motion can separate keep a part "
        "of it.</p>",
        Table(rows, header).html(),
    ]
    if motion is not None:
        parts.append(
            f"<p>The motion is one of {motion.duration:g} s, recorded in addition, with torque "
            "noise of 1 % of the effort limits.</p>"
        )
    if command:
        parts.append(
            f"<p>A more informative motion, within the limits: <code>{escape(command)}</code></p>"
        )
    return parts


def uncertainty_left(found: IdentifiedModel, more: Information | None = None) -> np.ndarray:
    """Return the share (p) of each dynamic parameter's initial deviation that data leave.

    Initially inertias are known to 30 % and coefficients of joints to their typical size; then
    deviations are those of (prior^-1 + H)^-1.

    Args:
        found: the identification, whose information counts.
        more: information of other data with the same parameters.
    """
    dynamics, H = found.estimator.controller.dynamics, found.dynamic.H
    prior = np.diag(np.maximum(dynamics.typical, np.finfo(float).tiny) ** 2)
    inertial = prior_covariance(found.estimator.controller.kinematics.robot, dynamics)
    if inertial is not None:
        prior[: len(inertial), : len(inertial)] = inertial
    if more is not None:
        order = [more.names.index(name) for name in found.dynamic.names if name in more.names]
        known = [k for k, name in enumerate(found.dynamic.names) if name in more.names]
        H = H.copy()
        H[np.ix_(known, known)] += more.H[np.ix_(order, order)]
    root = np.linalg.cholesky(prior)
    left = np.linalg.solve(np.eye(len(H)) + root.T @ H @ root, root.T)
    variances = np.einsum("ij,ji->i", root, left)
    return np.asarray(np.sqrt(np.clip(variances / np.diag(prior), 0.0, 1.0)))


def _share(left: np.ndarray, names: Sequence[str], joint: str, coefficients: bool) -> str:
    """Return the mean share of the parameters of a body, or of the coefficients of its joint."""
    own = [
        value
        for name, value in zip(names, left, strict=True)
        if name.rpartition(".")[0] == joint and (name.rpartition(".")[2] in KINDS) == coefficients
    ]
    return f"{np.mean(own):.0%}" if own else "-"


def _moved(robot: Robot, motion: MeasuredMotion, j: int) -> tuple[str, str, str, str]:
    """Return how far and fast a joint moved, and the shares of its limits."""
    low, high = (part[j] for part in position_limits(robot.model))
    start, limit = robot.model.idx_qs[j + 1], velocity_limits(robot.model)[j]
    fastest = float(np.abs(motion.v[:, j]).max())
    of_limit = f"{fastest / limit:.0%}" if np.isfinite(limit) else "-"
    if robot.model.nqs[j + 1] != 1:
        return "-", "-", f"{fastest:.3g}", of_limit
    span = float(np.ptp(motion.q[:, start]))
    share = f"{span / (high - low):.0%}" if np.isfinite(high - low) else "-"
    return f"{span:.3g}", share, f"{fastest:.3g}", of_limit
