"""How good the sensors are: how rarely and late a camera shows the task coordinates, and noise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

from ._checks import positive
from .exceptions import InputError, did_you_mean


@dataclass(frozen=True)
class Camera:
    """A camera or tracker that sees the task frame.

    Frames are taken at the multiples of 1 / rate and arrive ``delay`` later, or never.

    Attributes:
        rate: frames a second; None, or more than samples a second: one at every sample.
        delay: from a frame's taking to its arrival [s].
        dropout: share of the frames that never arrive, in [0, 1).

    Raises:
        InputError: a rate that is not positive, a negative delay, or a dropout outside [0, 1).
    """

    rate: float | None = None
    delay: float = 0.0
    dropout: float = 0.0

    def __post_init__(self) -> None:
        """Refuse numbers that no camera has."""
        if self.rate is not None:
            object.__setattr__(self, "rate", positive(self.rate, "camera.rate"))
        for name in ("delay", "dropout"):
            number = positive(getattr(self, name), f"camera.{name}", zero=True)
            object.__setattr__(self, name, number)
        if self.dropout >= 1.0:
            raise InputError(
                f"must be a share of the frames, below 1, got {self.dropout:g}.",
                where="camera.dropout",
            )

    @classmethod
    def of(cls, given: Camera | Mapping[str, float | None]) -> Camera:
        """Return a camera given as one, or by the names of its attributes.

        Raises:
            InputError: unknown names, or as the class.
        """
        if isinstance(given, Camera):
            return given
        if not isinstance(given, Mapping):
            raise InputError(f"expected a Camera or a mapping, got {given!r}.", where="camera")
        names = [field.name for field in fields(cls)]
        for name in given:
            if name not in names:
                raise InputError(
                    f"a camera has no '{name}'; it has {names}.{did_you_mean(str(name), names)}",
                    where="camera",
                )
        return cls(**given)  # type: ignore[arg-type]


@dataclass(frozen=True)
class SensorQuality:
    """How good sensors are, in the sizes that filters and rates depend on; perfect by default.

    Attributes:
        v: standard deviation of the joint velocity [rad/s or m/s].
        x: of a seen position [m].
        rate: frames of the camera [1/s].
        age: of the oldest frame that is still the last one [s]; zero if every sample has its own.
    """

    v: float = 0.0
    x: float = 0.0
    rate: float = 0.0
    age: float = 0.0

    def __post_init__(self) -> None:
        """Refuse numbers that no sensor has.

        Raises:
            InputError: a negative number, or none.
        """
        for field in fields(self):
            number = positive(getattr(self, field.name), f"sensors.{field.name}", zero=True)
            object.__setattr__(self, field.name, number)
