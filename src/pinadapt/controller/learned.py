"""What a controller has learned, as a robot and as numbers that another one starts from."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from .._checks import instance, numbers
from .._files import write_text
from .._version import __version__
from ..exceptions import ParameterError, did_you_mean
from ..models.translations import PlacedTranslations
from ..robot.robot import Robot
from .announcement import ControllerParts
from .state import ControllerState

_FORMAT = "pinadapt learned parameters"


def learned_robot(controller: ControllerParts, state: ControllerState) -> Robot:
    """Return the robot with the estimates of a state; see ``Controller.learned``.

    Raises:
        ParameterError: no physical bodies have these parameters.
    """
    kinematics, made_for = controller.kinematics, controller.nominal
    nominal = kinematics.robot if made_for is None else made_for.robot(made_for.load)
    learned = controller.dynamics.robot(state.a_d, nominal)
    model = learned.model.copy()
    PlacedTranslations(model, learned.frame_id, kinematics.translations).write(state.a_k)
    return replace(learned, model=model, loads=())


@dataclass(frozen=True)
class LearnedParameters:
    """Estimates by name, which a file keeps for the next controller.

    A controller starts from them by ``controller.init(measurement, **learned.start(controller))``,
    a simulation by ``simulate(..., **learned.start(controller))``, a scenario by the key
    ``learned`` of ``[belief]``.

    Attributes:
        robot: name of the robot.
        kinematic: name -> value [m].
        dynamic: name -> value.
        units: name -> unit of its value; empty for parameters of a basis of one's own.
        version: of the library that learned them.
    """

    robot: str
    kinematic: Mapping[str, float]
    dynamic: Mapping[str, float]
    units: Mapping[str, str]
    version: str = __version__

    @classmethod
    def of(cls, controller: ControllerParts, state: ControllerState) -> LearnedParameters:
        """Return the estimates in a state of a controller."""
        kinematics, dynamics = controller.kinematics, controller.dynamics
        units = {name: "m" for name in kinematics.names}
        units |= dict(zip(dynamics.names, dynamics.units, strict=True))
        return cls(
            kinematics.robot.name,
            dict(zip(kinematics.names, state.a_k.tolist(), strict=True)),
            dict(zip(dynamics.names, state.a_d.tolist(), strict=True)),
            units,
        )

    def start(self, controller: ControllerParts) -> dict[str, np.ndarray]:
        """Return ``a_k`` (p_k) and ``a_d`` (p_d) for a controller with the same parameters.

        Raises:
            ParameterError: its parameters have other names.
        """
        kinematic, dynamic = controller.kinematics.names, controller.dynamics.names
        return {
            "a_k": _in_order(self.kinematic, kinematic, "learned.kinematic"),
            "a_d": _in_order(self.dynamic, dynamic, "learned.dynamic"),
        }

    def save(self, path: Path | str) -> None:
        """Write a JSON file, whole or not at all; its folder is made if it is missing."""
        content = {
            "format": _FORMAT,
            "version": self.version,
            "robot": self.robot,
            "kinematic": self._rows(self.kinematic),
            "dynamic": self._rows(self.dynamic),
        }
        write_text(Path(path), json.dumps(content, indent=1, allow_nan=False) + "\n")

    @classmethod
    def load(cls, path: Path | str) -> LearnedParameters:
        """Read what ``save`` has written.

        Raises:
            ParameterError: no such file, or not one of these, or numbers that are not finite.
        """
        path = Path(path)
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise ParameterError(f"cannot be read: {error}.", where=str(path)) from error
        if not isinstance(content, dict) or content.get("format") != _FORMAT:
            raise ParameterError(f"is no file of {_FORMAT}.", where=str(path))
        try:
            tables = [
                {row["name"]: (row["value"], row["unit"]) for row in content[kind]}
                for kind in ("kinematic", "dynamic")
            ]
            robot, version = str(content["robot"]), str(content["version"])
        except (KeyError, TypeError) as error:
            raise ParameterError(f"lacks {error}.", where=str(path)) from error
        kinematic, dynamic = (_values(table, str(path)) for table in tables)
        units = {name: str(unit) for table in tables for name, (_, unit) in table.items()}
        return cls(robot, kinematic, dynamic, units, version)

    def _rows(self, values: Mapping[str, float]) -> list[dict[str, Any]]:
        return [
            {"name": name, "value": value, "unit": self.units[name]}
            for name, value in values.items()
        ]


def _values(table: Mapping[str, tuple[Any, Any]], where: str) -> dict[str, float]:
    """Return the numbers of a table, or refuse what is none."""
    values = numbers([value for value, _ in table.values()], where, error=ParameterError)
    return dict(zip(table, values.tolist(), strict=True))


def _in_order(values: Mapping[str, float], names: tuple[str, ...], where: str) -> np.ndarray:
    """Return the values (p) of exactly these names, in their order."""
    instance(values, Mapping, where, ParameterError)
    lacking = [name for name in names if name not in values]
    foreign = [name for name in values if name not in names]
    if lacking or foreign:
        first = (lacking or foreign)[0]
        raise ParameterError(
            f"these are {len(values)} parameters, the controller has {len(names)}; "
            f"{len(lacking)} are missing, {len(foreign)} unknown to it, the first is '{first}'."
            f"{did_you_mean(first, foreign if lacking else lacking)}",
            where=where,
            hint="Make it for the same robot, with the same unknown.",
        )
    return np.array([values[name] for name in names])
