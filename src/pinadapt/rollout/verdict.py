"""The outcome of a run in one line: accuracy, limits exceeded, what to try."""

from __future__ import annotations

import numpy as np

from .._output import percent
from ..laws import DEFAULT, LAWS
from ..tasks.task import DISPLAYS
from .recording import CLOSE, Recording, Ringing, extreme, window

ACCURATE, ROUGH = 0.02, 0.2  # errors in the last 10 %, relative to the path's extent
BETTER = 0.2  # error relative to that without adaptation, above which adaptation hardly helps
FOLLOWS, ROUGHLY, LOST = "follows", "follows roughly", "does not follow"
TURN = 0.2  # [rad] taken as the extent of a change of orientation
_POINT = CLOSE / ACCURATE  # taken as the extent of a point [m or rad]
_OFTEN, _MOSTLY = 0.05, 0.5  # shares of the samples
_SETTLED = 5.0  # [s] after which a loop with default gains has converged
_READABLE = 1e6  # larger numbers are written with an exponent
_MOTION = "desired"  # first word of the reason if the desired motion ended the loop
_SHOWN = 2  # times at which the path was slowed, in words
_FALLING = 0.7  # error in the last third of a run relative to the second, below which it falls


def error_share(rollout: Recording) -> float | None:
    """Return the largest error of the last 10 % relative to the path's extent; None for a point."""
    error = extreme(np.max, window(rollout.distance, False))
    return error / rollout.extent if error is not None and rollout.extent else None


def grade(rollout: Recording) -> str:
    """Return the verdict in a few words."""
    if rollout.diverged is not None:
        return f"diverged at {rollout.diverged:.3f} s"
    if rollout.interrupted is not None:
        return f"interrupted at {rollout.interrupted:.3f} s"
    worst = _worst(rollout)
    if worst is None:
        return "no finite error"
    return FOLLOWS if worst <= ACCURATE else ROUGHLY if worst <= ROUGH else LOST


def verdict(rollout: Recording) -> str:
    """Return the verdict in one line."""
    reason = str(rollout.reason or "").rstrip(".")
    slowed = f"path slowed {slowed_words(rollout)}" if rollout.slowed else ""
    predicted, rings = _prediction(rollout), _rings(rollout)
    parts = (reason, _error(rollout), slowed, _beyond(rollout), predicted, rings, _advice(rollout))
    return f"{grade(rollout)}: {'; '.join(part for part in parts if part)}."


def _worst(rollout: Recording) -> float | None:
    """Return the largest relative error of the last 10 %, of position or orientation."""
    error = extreme(np.max, window(rollout.distance, False))
    if error is None or rollout.angle is None:
        return None if error is None else error / (rollout.extent or _POINT)
    angle = extreme(np.max, window(rollout.angle, False))
    return None if angle is None else max(error / (rollout.extent or _POINT), angle / TURN)


def _error(rollout: Recording) -> str:
    """Return the error in the last 10 %: absolute, relative, and against no adaptation."""
    error = extreme(np.max, window(rollout.distance, False))
    if error is None:
        return "nothing was measured"
    unit, scale = DISPLAYS[rollout.task.groups[0].unit]
    text = f"error of the last 10 % up to {_short(scale * error)} {unit}"
    if (share := error_share(rollout)) is not None:
        text += (
            f", {_short(100 * share, 2)} % of the path's {_short(scale * rollout.extent)} {unit}"
        )
    if rollout.angle is not None:
        turn, angle = DISPLAYS["rad"], extreme(np.max, window(rollout.angle, False))
        text += "" if angle is None else f", and {_short(turn.scale * angle)} {turn.unit}"
    if rollout.unadapted is not None:
        without = f"{_short(scale * rollout.unadapted)} {unit} without adaptation"
        text += f", {_relative(error, rollout.unadapted)} the {without}"
    return text


def _prediction(rollout: Recording) -> str:
    """Return how well the last estimate predicts the torques of the motion, and the first did."""
    found = rollout.prediction
    if found is None or rollout.diverged is not None:
        return ""
    return (
        f"torques predicted to {percent(found.share_last)}, at first {percent(found.share_first)}"
    )


def ringing_words(ringing: Ringing) -> str:
    """Return at which frequency which torque rings, and how much."""
    return f"{ringing.joint} at {ringing.frequency:.2g} Hz, {ringing.share:.0%} of its torque"


def _rings(rollout: Recording) -> str:
    """Return that a torque rings, and what to do about it."""
    if rollout.ringing is None:
        return ""
    return (
        f"the torque rings, {ringing_words(rollout.ringing)}: motors are late or joints give way, "
        "more than the controller was told: declare it (controller.actuators, "
        "pa.Limits(actuators=...)), or take a larger lag and a smaller gamma_d"
    )


def _relative(error: float, other: float) -> str:
    """Return an error relative to another one, as a share or a factor."""
    tiny = np.finfo(float).tiny
    if error > BETTER * other:
        return f"{error / max(other, tiny):.0%} of"
    return f"{_short(other / max(error, tiny), 2)} times less than"


def _short(value: float, digits: int = 3) -> str:
    """Return a number with some significant digits, without an exponent up to a million."""
    whole = 10.0**digits <= value < _READABLE
    return f"{value:.0f}" if whole else f"{value:.{digits}g}"


def slowed_words(rollout: Recording) -> str:
    """Return when a governor slowed the path, and why, and how late the path is at the end."""
    longest = sorted(rollout.slowed, key=lambda each: each.start - each.end)[:_SHOWN]
    words = [
        f"from {_short(each.start)} to {_short(each.end)} s by {each.cause} (rate down to "
        f"{round(each.least_rate, 2):g})"
        for each in sorted(longest)
    ]
    if more := len(rollout.slowed) - len(longest):
        words.append(f"{more} more times")
    if rollout.path_time is not None:
        words.append(f"{_short(float(rollout.t[-1] - rollout.path_time[-1]), 2)} s late at the end")
    return ", ".join(words)


def _beyond(rollout: Recording) -> str:
    """Return which joints exceed which limits, if the description states any."""
    limits = rollout.limits
    return limits.words() if limits.exceeded else "joint limits kept" if limits.stated else ""


def _advice(rollout: Recording) -> str:
    """Return the most likely remedy for a run that went badly, or nothing."""
    if rollout.interrupted is not None or grade(rollout) == FOLLOWS or rollout.ringing is not None:
        return ""
    if rollout.diverged is not None:
        if str(rollout.reason).startswith(_MOTION):
            return ""
        if rollout.saturated.mean() > _MOSTLY:
            return _relief(rollout)
        often = f"{_at_limit(rollout)}; " if rollout.saturated.mean() > _OFTEN else ""
        return (
            f"{often}try a fifth of controller.gamma_k or gamma_d, a longer reference.period, or a "
            "shorter simulation.dt"
        )
    law = LAWS.get(rollout.law)
    if law is not None and not law.adapts:
        return "this law does not adapt: try another controller.law"
    if rollout.adaptation == "none":
        return 'nothing was adapted: try controller.adaptation = "natural"'
    if law is not None and law.set_point and not _falling(rollout.distance):
        return _set_point()
    if rollout.saturated.mean() > _OFTEN:
        return _relief(rollout)
    if (rollout.damping > 0.0).mean() > _OFTEN:
        return "the path comes close to a singularity: try another robot.q0 or a smaller path"
    if rollout.t[-1] < _SETTLED or _falling(rollout.distance):
        return "the error was still falling: try a longer simulation.duration"
    return "try controller.gamma_d three times as large, then gamma_k"


def _set_point() -> str:
    """Return the remedy for a set point that is not reached."""
    return (
        "this law does not adapt the kinematics: measure the tool, take a set point inside the "
        f'workspace, or set controller.law = "{DEFAULT}", which adapts'
    )


def _relief(rollout: Recording) -> str:
    """Return the remedy for saturated motors."""
    return f"{_at_limit(rollout)}: try a longer reference.period, a smaller path, or a smaller load"


def _at_limit(rollout: Recording) -> str:
    """Return how often the motors were saturated."""
    return f"the motors were at their limit {rollout.saturated.mean():.0%} of the time"


def _falling(distance: np.ndarray) -> bool:
    """Tell whether the largest error of the last third is clearly below that of the second."""
    before, last = (part.max(initial=0.0) for part in np.array_split(distance, 3)[1:])
    return bool(last < _FALLING * before)
