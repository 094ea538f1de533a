"""A controller as its users read it: for which robot it is, what it does and what it adapts."""

from __future__ import annotations

import numpy as np

from .._table import Sheet, Table
from .belief import ControllerParts


def controller_sheet(controller: ControllerParts) -> Sheet:
    """Return law, gains, what is adapted, sampling period and torque limits, with units."""
    kinematics, dynamics, law = controller.kinematics, controller.dynamics, controller.law
    velocity, position = getattr(law, "units", ("", ""))
    gains = (("K_v", velocity), ("K_P", position), ("alpha", "1/s"))
    rows = [
        ("robot", _robot(controller)),
        ("task", f"{kinematics.task.name} of {kinematics.frame}"),
        *((name, f"{_gain(law, name)} {unit}") for name, unit in gains if hasattr(law, name)),
        ("kinematic", _adapted(kinematics.names, controller.adaptation_k.name)),
        ("dynamic", _adapted(dynamics.names, controller.adaptation_d.name)),
        ("torque limits", _limits(controller)),
    ]
    if np.isfinite(controller.period):
        rows.append(("period", f"{1e3 * controller.period:g} ms"))
    return Sheet(f"controller, {getattr(law, 'name', type(law).__name__)}", [Table(rows)])


def _robot(controller: ControllerParts) -> str:
    joints = f"{controller.kinematics.nv} joints"
    belief = controller.belief
    return joints if belief is None else f"{belief.unloaded.name}, {joints}"


def _gain(law: object, name: str) -> str:
    """Return a gain as a number, or one an axis where they differ."""
    value = np.atleast_1d(np.asarray(getattr(law, name), dtype=float))
    numbers = [f"{x:.3g}" for x in (np.diag(value) if value.ndim == 2 else value)]
    return numbers[0] if len(set(numbers)) == 1 else ", ".join(numbers)


def _adapted(names: tuple[str, ...], adaptation: str) -> str:
    """Return how many parameters are adapted and how, and the names of a few."""
    if not names:
        return "known"
    few = f" ({', '.join(names)})" if len(names) <= 3 else f" ({names[0]} to {names[-1]})"
    return f"{len(names)} parameters{few}, {adaptation}"


def _limits(controller: ControllerParts) -> str:
    limits = controller.limits.torque
    if limits is None:
        return "none"
    return ", ".join(f"{x:.4g}" if np.isfinite(x) else "-" for x in limits) + " N m or N"
