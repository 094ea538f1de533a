"""What a controller has learned, as a robot and as numbers that another one starts from."""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import compress
from pathlib import Path
from typing import Any

import numpy as np

from .._checks import ROUNDING, instance, numbers
from .._output import percent, write_text
from .._version import __version__
from ..adaptation.adaptation import Estimate
from ..exceptions import ParameterError, did_you_mean
from ..models.excited import Excited, names_together
from ..models.joint_effects import KINDS
from ..models.physical_fit import around, nearest_with
from ..models.regressor import LABELS
from ..robot.changes import Friction, Shaft
from ..robot.robot import Robot
from .announcement import ControllerParts
from .state import ControllerState

_FORMAT = "pinadapt learned parameters"


_TOLERANCE = 1e-3  # largest change of the torques, as a share of them, and at most a tenth of the
# error of those that the estimate predicts; half: more is kept of what the motion hardly shows,
# twice: less


@dataclass(frozen=True, eq=False)
class AlongExcited:
    """What a motion identifies of the estimates, relative to their start.

    Attributes:
        excited: the combinations of the parameters that the motion excites.
        error: of the torques that the estimate predicts, as ``TorqueErrors.relative_error``.
    """

    excited: Excited
    error: float = np.inf

    def estimate(
        self, controller: ControllerParts, state: ControllerState
    ) -> tuple[np.ndarray, str]:
        """Return the parameters (p) nearest to the start that predict the same torques.

        Nearest in the metric of natural adaptation where the parameters are those of bodies, so
        that these are physical; else in the metric of the adaptation. The torques of the motion
        change by a tenth of their present error, and by at most a thousandth of themselves.

        Returns:
            The parameters, and words that say which are as at the start. Where there are no such
            parameters, those of the state.
        """
        rows = self.excited.rows
        a = state.a_d
        start = state.a_0
        tolerance = min(max(0.1 * self.error, 1e-9), _TOLERANCE)
        dynamics = controller.dynamics
        adaptation = controller.adaptation_d
        if dynamics.per_body:
            found = nearest_with(rows, a, around(dynamics, start), tolerance)
        else:
            values, vectors = np.linalg.eigh(adaptation.gain(Estimate(start)))
            G = vectors * np.sqrt(np.maximum(values, 0.0))
            found = start + G @ np.linalg.pinv(rows @ G, rcond=tolerance) @ rows @ (a - start)
        if found is None or not adaptation.contains(found):
            words = (
                "All estimates are kept as learned: no parameters near the initial ones reproduce "
                "the torques."
            )
            warnings.warn(words, stacklevel=3)
            return a, words
        still = list(compress(self.excited.names, self.excited.still))
        moved = percent(float(np.linalg.norm(rows @ (found - a))))
        kept = f"Not excited by the motion: {names_together(still)}. " if still else ""
        words = (
            f"{kept}Combinations that the motion does not identify are as near to the initial "
            f"values as possible; the torques differ from those of the last estimate by {moved}."
        )
        return found, words


_SHAPES = ("threshold", "breakaway", "fading")


@dataclass(frozen=True)
class LearnedParameters:
    """Estimates by name, which a file keeps for the next controller.

    A controller starts from them by ``controller.init(measurement, **learned.start(controller))``,
    a simulation by ``simulate(..., **learned.start(controller))``, a scenario by the key
    ``learned`` of ``[model]``.

    Attributes:
        robot: name of the robot.
        kinematic: name -> value [m].
        dynamic: name -> value.
        units: name -> unit of its value; empty for parameters of a user's own basis.
        version: of the library that learned them.
        remark: which of them are as at the start, because the motion did not excite them.
        information: rows R of numbers, one a dynamic parameter: R^T R is the information of the
            data, the inverse covariance of the estimates where it has full rank. Empty if unknown.
        shape: of the joints' friction, whose coefficients are parameters: ``threshold``,
            ``breakaway`` and ``fading``, one number a joint, and ``shafts`` of two joints; see
            ``Friction``. Empty for the usual one.
    """

    robot: str
    kinematic: Mapping[str, float]
    dynamic: Mapping[str, float]
    units: Mapping[str, str]
    version: str = __version__
    remark: str = ""
    information: tuple[tuple[float, ...], ...] = ()
    shape: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        controller: ControllerParts,
        state: ControllerState,
        along: AlongExcited | None = None,
        rows: Iterable[np.ndarray] = (),
    ) -> LearnedParameters:
        """Return the estimates in a state of a controller.

        Args:
            controller: that adapted.
            state: of it.
            along: what a motion excites; combinations that it does not are as at the start.
            rows: (r, p) the information of the data.
        """
        a_d, words = (state.a_d, "") if along is None else along.estimate(controller, state)
        kinematics = controller.kinematics
        dynamics = controller.dynamics
        return cls(
            kinematics.robot.name,
            dict(zip(kinematics.names, state.a_k.tolist(), strict=True)),
            dict(zip(dynamics.names, a_d.tolist(), strict=True)),
            _units(controller),
            remark=words,
            information=tuple(tuple(float(f"{x:.9g}") for x in row) for row in rows),
            shape=_shape_of(kinematics.robot.friction),
        )

    @property
    def joint_coefficients(self) -> list[str]:
        """The dynamic parameters of joints and shafts, as ``Unknown.effects`` names them."""
        return [name for name in self.dynamic if name.rpartition(".")[2] in KINDS]

    def start(
        self, controller: ControllerParts, *, same_load: bool = False
    ) -> dict[str, np.ndarray | None]:
        """Return ``a_k`` (p_k), ``a_d`` (p_d) and ``information`` (r, p_d) to start from.

        Translations of which nothing was learned start as the controller's model has them. A
        robot of another name causes a warning.

        Args:
            controller: with the same dynamic parameters.
            same_load: whether the load is the one that was learned. Otherwise the information
                leaves the bodies of the task frames out, so that it holds for any load.

        Raises:
            ParameterError: its parameters have other names or units.
        """
        kinematics = controller.kinematics
        dynamic = controller.dynamics.names
        start: dict[str, np.ndarray | None] = {
            "a_k": None
            if not self.kinematic
            else _in_order(self.kinematic, kinematics.names, "learned.kinematic"),
            "a_d": _in_order(self.dynamic, dynamic, "learned.dynamic"),
        }
        if not self.units.items() <= _units(controller).items():
            raise ParameterError("its parameters have other units.", where="learned")
        if self.robot != kinematics.robot.name:
            warnings.warn(
                f"what a '{self.robot}' has learned starts a '{kinematics.robot.name}'.",
                stacklevel=2,
            )
        if self.information:
            rows = np.array(self.information)
            names = list(self.dynamic)
            if not same_load:
                joints = kinematics.joint_names
                rows = _without(rows, names, [joints[k] for k in kinematics.robot.carriers])
            start["information"] = rows[:, [names.index(name) for name in dynamic]]
        return start

    def shaped(self, robot: Robot) -> Robot:
        """Return a robot whose friction has the learned shape, with its own coefficients.

        Raises:
            RobotError: a shape for other joints.
        """
        return replace(robot, friction=_shaped(robot.friction, self.shape))

    def save(self, path: Path | str) -> None:
        """Write a JSON file, whole or not at all; its folder is made if it is missing."""
        content = {"format": _FORMAT, **asdict(self)}
        write_text(Path(path), json.dumps(content, indent=1, allow_nan=False) + "\n")

    @classmethod
    def load(cls, path: Path | str) -> LearnedParameters:
        """Read what ``save`` has written.

        Raises:
            ParameterError: no such file, or not one of these, or numbers that are not finite.
        """
        where = str(path)
        try:
            content = json.loads(Path(path).read_text(encoding="utf-8"))
            if content.pop("format") != _FORMAT:
                raise ValueError("another format")
            found = cls(**content)
            for name in ("kinematic", "dynamic", "units", "shape"):
                instance(getattr(found, name), Mapping, name)
            for text in (found.robot, found.version, found.remark, *found.units.values()):
                instance(text, str, where)
            _shaped(Friction(), found.shape)
            numbers([*found.kinematic.values(), *found.dynamic.values()], where)
            rows = numbers(found.information, where)
            if rows.size and rows.shape[1:] != (len(found.dynamic),):
                raise ValueError(f"information has not {len(found.dynamic)} numbers in each row")
        except (OSError, KeyError, TypeError, AttributeError, ValueError, RecursionError) as error:
            words = f"is no file of {_FORMAT}: {type(error).__name__} {error}."
            raise ParameterError(words, where=where) from error
        return replace(found, information=tuple(tuple(row) for row in rows.tolist()))


def _units(controller: ControllerParts) -> dict[str, str]:
    """Return the units of all parameters, by name."""
    parts = controller.kinematics, controller.dynamics
    return {k: v for part in parts for k, v in zip(part.names, part.units, strict=True)}


def _without(rows: np.ndarray, names: Sequence[str], bodies: Sequence[str]) -> np.ndarray:
    """Return what rows (r, p) say whatever the ten parameters of some bodies are.

    With C the columns of these, (1 - C C^+) R: its square is the Schur complement of their block in
    R^T R.
    """
    own = np.isin(names, [f"{body}.{part}" for body in bodies for part in LABELS])
    sizes = np.linalg.norm(rows[:, own], axis=0)
    columns = rows[:, own] / np.maximum(sizes, np.finfo(float).tiny)
    left = rows - columns @ (np.linalg.pinv(columns, ROUNDING) @ rows)
    left[:, own] = 0.0
    return left


def _shape_of(friction: Friction) -> dict[str, Any]:
    """Return what differs from the usual shape of friction, as ``LearnedParameters.shape``."""
    special = friction.special.items()
    shape: dict[str, Any] = {name: part.tolist() for name, part in special if name in _SHAPES}
    if friction.shafts:
        shape["shafts"] = [
            [list(part.joints), part.sign, part.threshold] for part in friction.shafts
        ]
    return shape


def _shaped(friction: Friction, shape: Mapping[str, Any]) -> Friction:
    """Return friction with a shape as ``_shape_of`` returns it."""
    given: dict[str, Any] = dict(shape)
    if "shafts" in given:
        given["shafts"] = tuple(
            Shaft(tuple(joints), sign, threshold=width) for joints, sign, width in given["shafts"]
        )
    return replace(friction, **given)


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
            hint="Make it for the same robot, with the same unknown; in a scenario [unknown] joint "
            'may be left out, or "all": then it follows from the file.',
        )
    return np.array([values[name] for name in names])
