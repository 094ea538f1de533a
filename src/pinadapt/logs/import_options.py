"""How a recorded log is to be read: ``ImportOptions``, kept in a small TOML file beside the log.

It holds what a log does not contain: columns, rate, names and order of the joints, units,
gears, signs, and how the arm was mounted. It is applied in this order:

1. columns give t, q, v and tau, ``rate`` the times, ``repeated`` leaves samples out;
2. ``joints`` puts the columns into the order of the robot;
3. ``degrees``, then for motors with gears G, q_m = G q: q = G^-1 q_m, v = G^-1 v_m,
   tau = G^T K tau_m, with the torque gains K, such as N m/A;
4. ``flip`` changes signs, ``offset`` is added to the positions.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import tomlkit
from numpy.typing import ArrayLike

from .._checks import (
    flag,
    located,
    mapping,
    name_list,
    numbers,
    positive,
    vector,
    word,
)
from .._output import read_toml
from ..exceptions import InputError, LogError
from ..robot.changes import per_joint
from ..robot.robot import Robot
from .log import NAMES, SIGNALS, Log, joint_order

SUFFIX = ".import_options.toml"
REPEATED = ("refuse", "drop")
MOUNTS = ("floor", "wall", "ceiling")


@dataclass(frozen=True)
class ImportOptions:
    """How a log is to be read.

    Numbers of the joints are one for all, a list in the order of the robot's joints, or a mapping
    from some of their names.

    Attributes:
        columns: signal (t, q, v, tau, x, x_time) -> names of its columns in the robot's order, or
            one with a ``*`` for each joint's name or index; a file without header has columns 1, 2
            and so on, also as ranges such as "2-8".
        joints: names of the log's joints in the order of the robot's; where the log has no names,
            those of the robot's joints in the order of its columns; or signal -> such names.
        rate: of the samples [Hz], for logs without times or with times that jitter.
        repeated: "refuse" a log with repeated samples, or "drop" these.
        degrees: whether angles and their velocities are in degrees.
        gear: turns of the motor for one of the joint, negative where it turns the other way; for
            coupled joints a matrix G (n, n) of motor angles G q. Where the torques alone are those
            of the motors, ``torque_gain`` takes G^T.
        torque_gain: torque for a unit of what was recorded, such as N m/A; or a matrix (n, n).
        flip: joints whose torque has the other sign; "q:NAME" for position and velocity.
        offset: added to the positions [rad or m].
        topic: of a bag's joint states, where it has several.
        pose_topic: of the frame's position in a bag.
        compensated: "nominal" if the arm compensates its gravity and logs the rest only.
        gravity: (3) in the axes of the robot's base [m/s^2].
        mount: "floor", "ceiling", or "wall": then the torques show where down is.
        doubtful: whether to go on although the torques do not fit the description.
    """

    columns: Mapping[str, str | Sequence[str]] = field(default_factory=dict)
    joints: Sequence[str] | Mapping[str, Sequence[str]] = ()
    rate: float | None = None
    repeated: str = "refuse"
    degrees: bool = False
    gear: ArrayLike | Mapping[str, float] | None = None
    torque_gain: ArrayLike | Mapping[str, float] | None = None
    flip: Sequence[str] = ()
    offset: ArrayLike | Mapping[str, float] | None = None
    topic: str | None = None
    pose_topic: str | None = None
    compensated: str | None = None
    gravity: ArrayLike | None = None
    mount: str | None = None
    doubtful: bool = False

    def __post_init__(self) -> None:
        """Check everything that needs no robot.

        Raises:
            InputError: values of the wrong kind, unknown words, or both gravity and mount.
        """
        with located("import_options", vars(self)):
            for signal in mapping(self.columns, "columns"):
                word(signal, NAMES, "columns")
            if self.rate is not None:
                positive(self.rate, "rate", error=InputError)
            word(self.repeated, REPEATED, "repeated")
            flag(self.degrees, "degrees")
            flag(self.doubtful, "doubtful")
            name_list(self.flip, "flip")
            for signal, names in self._joint_lists.items():
                word(signal, SIGNALS, "joints")
                name_list(names, "joints")
            word(self.compensated or "nominal", ("nominal",), "compensated")
            word(self.mount or "floor", MOUNTS, "mount")
            if self.gravity is not None:
                vector(self.gravity, 3, "gravity", fills=False)
                if self.mount is not None:
                    raise InputError("gravity says already how the arm is mounted.", where="mount")

    @classmethod
    def of(cls, given: Options | None, log: object = None) -> ImportOptions:
        """Return the options from themselves, their fields or a TOML file.

        For None they are those of the file beside a log, or the defaults without one.

        Raises:
            InputError: no such file, no TOML, an unknown key or a wrong value.
        """
        given = cls.beside(log) if given is None else given
        if given is None or isinstance(given, ImportOptions):
            return given or cls()
        table = given if isinstance(given, Mapping) else read_toml(Path(given))
        for key in table:
            word(key, vars(cls()), "import_options")
        return cls(**table)

    @classmethod
    def beside(cls, log: object) -> Path | None:
        """Return the path of the file beside a log, None where there is none."""
        if isinstance(log, Path | str) and (path := place_beside(log)).is_file():
            return path
        return None

    def updated(self, **given: Any) -> ImportOptions:
        """Return the options with other values, columns merged; None leaves one as it is."""
        chosen = {name: value for name, value in given.items() if value is not None}
        chosen["columns"] = {**self.columns, **chosen.get("columns", {})}
        if "gravity" in chosen or "mount" in chosen:
            chosen = {"gravity": None, "mount": None, **chosen}
        return replace(self, **chosen)

    def mounted(self, robot: Robot) -> Robot:
        """Return a robot with the stated gravity; on a wall it is not known here."""
        if self.gravity is None and self.mount in (None, "wall"):
            return robot
        model = robot.model.copy()
        size = np.linalg.norm(model.gravity.linear)
        down = {"floor": -size, "ceiling": size}
        gravity = (0.0, 0.0, down[self.mount]) if self.mount else self.gravity
        model.gravity.linear = np.asarray(gravity, dtype=float)
        return replace(robot, model=model)

    def converted(self, log: Log, robot: Robot) -> Log:
        """Return a log of a robot's joints, in its order, in SI units and behind the gears.

        Raises:
            InputError: wrong sizes, unknown joints, gears that cannot be inverted, or positions
                with more numbers than there are joints.
        """
        log = self._in_order_of(robot, log)
        names = robot.joint_names
        n = robot.model.nv
        signs = self._signs(names)
        G = _matrix(self.gear, names, "gear")
        K = _matrix(self.torque_gain, names, "torque_gain")
        if np.linalg.matrix_rank(G) < n:
            raise LogError(
                "these gears cannot be inverted: some joint would not move.",
                where="import_options.gear",
                hint="Row i has the turns of motor i for one turn of each joint.",
            )
        scale = np.where(self.degrees & ~robot.sliding, math.pi / 180.0, 1.0)
        A = signs["q"][:, None] * np.linalg.inv(G) * scale
        offset = per_joint(self.offset, names, "import_options.offset", 0.0)
        log = replace(log, tau=_mapped(signs["tau"][:, None] * (G.T @ K), log.tau))
        if np.array_equal(A, np.eye(n)) and not offset.any():
            return log
        if log.q.shape[1] != n:
            raise LogError(
                f"{log.q.shape[1]} numbers for {n} joints are configurations with cosines and "
                "sines, which units, gears, signs and offsets do not apply to.",
                where=f"{log.source}: q",
                hint="Record one angle for each joint.",
            )
        return replace(
            log, q=_mapped(A, log.q) + offset, v=None if log.v is None else _mapped(A, log.v)
        )

    def _signs(self, names: list[str]) -> dict[str, np.ndarray]:
        """Return signal -> the sign (n) of each joint."""
        found = {signal: np.ones(len(names)) for signal in ("q", "tau")}
        for entry in self.flip:
            signal, _, name = entry.rpartition(":")
            word(signal or "tau", found, "import_options.flip")
            word(name, names, "import_options.flip")
            found[signal or "tau"][names.index(name)] *= -1.0
        return found

    def _in_order_of(self, robot: Robot, log: Log) -> Log:
        """Return a log with its columns in the order of a robot's joints."""
        names = robot.joint_names
        if set(names) <= set(log.joints) or not (log.joints and self.joints):
            log = log.of(robot)
        for signal, own in self._joint_lists.items():
            if not len(set(own)) == len(own) == len(names):
                raise LogError(
                    f"expected a joint of the log for each of {names}, got {own}.",
                    where="import_options.joints",
                )
            found, wanted = (log.joints, own) if log.joints else (own, names)
            log = log.ordered(joint_order(found, wanted, log.source), (signal,))
        return replace(log, joints=tuple(names)).of(robot)

    @property
    def _joint_lists(self) -> Mapping[str, Sequence[str]]:
        """Signal -> names of its joints in the robot's order."""
        if isinstance(self.joints, Mapping):
            return self.joints
        return dict.fromkeys(SIGNALS, self.joints) if self.joints else {}

    def text(self, comments: Sequence[str] = ()) -> str:
        """Return what is stated as TOML, below comments."""
        default = vars(ImportOptions())
        stated = {
            name: np.asarray(value).tolist() if isinstance(value, np.ndarray | tuple) else value
            for name, value in vars(self).items()
            if not np.array_equal(value, default[name])
        }
        return "".join(f"# {line}\n" for line in comments) + tomlkit.dumps(stated)


Options: TypeAlias = ImportOptions | Mapping[str, Any] | Path | str  # as they may be given


def place_beside(log: Path | str) -> Path:
    """Return the place of the options of a log: of ``run.csv``, ``run.import_options.toml``."""
    path = Path(log)
    return path.parent / ((path.stem if path.suffix else path.name) + SUFFIX)


def _matrix(given: Any, names: Sequence[str], key: str) -> np.ndarray:
    """Return gains or gears as a matrix (n, n); None: one."""
    where = f"import_options.{key}"
    if given is not None and not isinstance(given, Mapping):
        whole = numbers(given, where)
        if whole.shape == (len(names), len(names)):
            return whole
    return np.diag(per_joint(given, names, where, 1.0))


def _mapped(A: np.ndarray, part: np.ndarray) -> np.ndarray:
    """Return A y for each row y; where A is diagonal, NaN stays with its joint."""
    diagonal = np.diag(A)
    return part * diagonal if np.array_equal(A, np.diag(diagonal)) else part @ A.T
