"""The time that passes from sample to sample, as the samples say it."""

from __future__ import annotations

from ..exceptions import ImplausibleError, InputError
from .residuals import TIME, MonitorState

LATEST, _PAUSE = 10.0, 0.01  # periods, and [s] that one step may bridge, whichever is longer;
# half: more pauses end a run, double: the estimates take longer steps


def elapsed(before: float, now: float, dt: float, period: float, read: bool) -> tuple[float, float]:
    """Return the time [s] that a sample at time ``now`` stands for, and that since the last.

    The former is dt, or the time since the sample before where others were dropped in between,
    or none where that sample had the same time. Where times are not ``read``, both are dt.

    Raises:
        ImplausibleError: the time goes back.
        InputError: the period is not positive, or longer than one step may bridge.
    """
    longest = max(LATEST * period, _PAUSE)
    since = now - before if read else dt
    try:
        fits = 0.0 < dt <= longest and since <= longest
    except (TypeError, ValueError):
        fits = False
    if not fits:
        raise InputError(
            f"must be positive and at most {longest:g} s, got {dt!r} and {since!r}.",
            where="dt",
            hint="After a longer pause start anew with `init`, from the last estimates.",
        )
    if since < 0.0:
        raise ImplausibleError("t", now, f"is before the last sample's, {before:g} s")
    # one was dropped: between one and two
    return since if since == 0.0 or since > 1.5 * dt else dt, since


def stood(monitor: MonitorState, now: float, dt: float) -> None:
    """Count a sample with the time ``now`` of the one before [s], in place of dt later.

    Raises:
        ImplausibleError: it has been the same for too long.
    """
    monitor.since[TIME] = min(monitor.since[TIME], monitor.time) - dt
    if monitor.lasts(TIME):
        samples = 1.0 + (monitor.time - monitor.since[TIME]) / dt
        raise ImplausibleError("t", now, f"has been the same for {samples:.0f} samples")
