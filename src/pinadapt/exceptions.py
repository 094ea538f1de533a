"""The errors of pinadapt: what was wrong, where, and what to try."""

from __future__ import annotations

import copyreg
import difflib
from collections.abc import Iterable
from pathlib import Path
from typing import Any


def did_you_mean(name: object, allowed: Iterable[str]) -> str:
    """Return ``" Did you mean 'x'?"`` for the nearest allowed name, else an empty string."""
    allowed = list(allowed)
    exact = [other for other in allowed if other.lower() == str(name).lower()]
    close = exact or difflib.get_close_matches(str(name), allowed, n=1, cutoff=0.5)
    return f" Did you mean '{close[0]}'?" if close else ""


class PinadaptError(Exception):
    """Root of all errors raised by pinadapt.

    Attributes:
        what: what was wrong.
        where: the place it was found (a file, a key, an argument), or None.
        hint: what to try, or None.
    """

    def __init__(
        self, what: str, *, where: str | Path | None = None, hint: str | None = None
    ) -> None:
        """Put what, where and hint into one message."""
        self.what = what
        self.where = str(where) if where else None
        self.hint = hint
        message = f"{where}: {what}" if where else what
        super().__init__(f"{message} {hint}" if hint else message)

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy and pickle message and attributes; ``args`` are not what ``__init__`` takes."""
        make = copyreg.__newobj__  # type: ignore[attr-defined]
        return make, (type(self), *self.args), self.__dict__


class InputError(PinadaptError, ValueError):
    """The input was refused before anything moved."""


class RobotError(InputError):
    """A robot description that cannot be used: file, frame, joints, masses or sizes."""


class GainError(InputError):
    """A gain that breaks a hypothesis of the law: sign, definiteness or size."""


class ParameterError(InputError):
    """A set of unknown parameters, or an estimate of them, that cannot be used."""


class LogError(InputError):
    """A recorded motion that cannot be used: file, columns, topics, times, units or lengths."""


class TorqueMismatchError(LogError):
    """A log whose torques cannot be those of the described robot; nothing was learned from it.

    Attributes:
        check: the ``TorqueCheck``: factors and correlations of the joints, and likely causes.
    """

    check: Any = None


class ScenarioError(InputError):
    """A key or value of a scenario that is not allowed."""


class UnusedGainWarning(UserWarning):
    """A gain was given that the chosen law or adaptation does not use."""


class MeasurementError(PinadaptError):
    """A measurement that cannot be used, mostly because it is not finite; the state is untouched.

    Attributes:
        field: name of the measured signal.
        value: what was measured.
        flaw: what is wrong with it.
        guess: how a sensor or a driver may have caused it, or nothing.
        hint: what to do.
    """

    def __init__(
        self,
        field: str,
        value: object,
        flaw: str = "is not finite",
        guess: str = "",
        hint: str = "Go on with the next measurement. A controlled arm needs the torque of "
        "controller.safe(state, measurement) until then: the last one would move it.",
    ) -> None:
        """Name the signal, its value, what is wrong with it, and the likely fault of a sensor."""
        self.field, self.value, self.flaw, self.guess = field, value, flaw, guess
        why = f" ({guess})" if guess else ""
        super().__init__(
            f"measurement '{field}' {flaw}{why}: {value}. The estimates were left as they were.",
            hint=hint,
        )


class ImplausibleError(MeasurementError):
    """A finite measurement that is implausible for this robot at this time; see ``Guards``."""


class Interrupted(KeyboardInterrupt):
    """Somebody stopped a simulation; like any ``KeyboardInterrupt`` it stops a script as well.

    Attributes:
        rollout: the ``Rollout`` until then; its ``interrupted`` says when.
    """

    def __init__(self, rollout: Any) -> None:
        """Keep the rollout."""
        self.rollout = rollout
        super().__init__(f"interrupted at {rollout.interrupted:.3f} s")

    def __reduce__(self) -> tuple[type[Interrupted], tuple[Any]]:
        """Be made again from the rollout in another process."""
        return type(self), (self.rollout,)


class ArmError(PinadaptError):
    """An arm that cannot be driven now: silent, stopped, in error, or refusing the control."""


class DivergedError(PinadaptError):
    """The closed loop diverged.

    Attributes:
        reason: which quantity, and what is known about why.
        time: of the loop [s] when it did, or None where only the loop around knows it.
    """

    def __init__(self, reason: str, time: float | None = None) -> None:
        """Keep the reason and the time [s]."""
        self.reason = reason
        self.time = time
        super().__init__(reason)


class ContactError(DivergedError):
    """A contact that is taken to stand has lifted or slipped, so that no constraint holds there.

    Attributes:
        frame: that of the contact.
    """

    def __init__(self, reason: str, frame: str = "") -> None:
        """Keep the reason and the contact's frame."""
        self.frame = frame
        super().__init__(reason)
