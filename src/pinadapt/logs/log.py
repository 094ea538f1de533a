"""A recorded motion of a robot's joints, with the torques of its motors."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from .._checks import instance
from ..description.chain import configuration_from_angles
from ..exceptions import LogError, did_you_mean
from ..robot.robot import Robot

_EPOCH = 1e6  # [s] beyond which times are of a clock on the wall


@dataclass(frozen=True, eq=False)
class Log:
    """N samples of n joints in rad, m, N m, N and s; NaN where something was not measured.

    Attributes:
        t: (N) times [s], ascending.
        q: (N, n) one number a joint, or (N, nq) configurations as Pinocchio has them.
        tau: (N, n) torques of the joints.
        v: (N, n) velocities, or None: they are taken from q.
        joints: (n) names of the columns, or none: the robot's, in its order.
        x: (M, m) position of the frame in world axes, for a pose with a quaternion xyzw; or None.
        x_time: (M) times of x [s]; None: t.
        held: whether tau[k] was held from t[k] until the next sample, as a controller's command is;
            else it was measured at t[k].
        source: where it is from, for messages.
    """

    t: np.ndarray
    q: np.ndarray
    tau: np.ndarray
    v: np.ndarray | None = None
    joints: tuple[str, ...] = ()
    x: np.ndarray | None = None
    x_time: np.ndarray | None = None
    held: bool = False
    source: str = "log"

    def __post_init__(self) -> None:
        """Turn everything into arrays of floats whose sizes fit.

        Raises:
            LogError: they do not.
        """
        for name, dimensions in (("t", 1), ("q", 2), ("tau", 2), ("v", 2), ("x", 2), ("x_time", 1)):
            given = getattr(self, name)
            if given is not None:
                object.__setattr__(self, name, self._array(given, name, dimensions))
        for name in ("q", "tau", "v"):
            given = getattr(self, name)
            if given is not None and len(given) != len(self.t):
                raise LogError(f"{len(given)} rows for {len(self.t)} times.", where=self._at(name))
        times = self.t if self.x_time is None else self.x_time
        if self.x is not None and len(self.x) != len(times):
            raise LogError(
                f"{len(self.x)} rows for {len(times)} times.",
                where=self._at("x"),
                hint="Frames of a slow camera need times of their own, x_time, or rows of NaN "
                "between them.",
            )

    @property
    def duration(self) -> float:
        """From the first sample to the last [s]."""
        return float(self.t[-1] - self.t[0]) if len(self.t) else 0.0

    @property
    def period(self) -> float:
        """Median time between samples [s]."""
        return float(np.median(np.diff(self.t))) if len(self.t) > 1 else 0.0

    def frames(self) -> tuple[np.ndarray, np.ndarray]:
        """Return times (k) and coordinates (k, m) of the frames that are finite."""
        if self.x is None:
            return np.zeros(0), np.zeros((0, 0))
        times = self.t if self.x_time is None else self.x_time
        seen = np.isfinite(self.x).all(axis=1) & np.isfinite(times)
        return times[seen], self.x[seen]

    def of(self, robot: Robot) -> Log:
        """Return the log with the columns of a robot's joints, in its order.

        Raises:
            LogError: a joint is missing, or the columns are not as many as there are joints.
        """
        names = instance(robot, Robot, "robot").joint_names
        if self.joints and list(self.joints) != names:
            order = [self._column(name) for name in names]
            v = None if self.v is None else self.v[:, order]
            q, tau = self.q[:, order], self.tau[:, order]
            return replace(self, joints=tuple(names), q=q, v=v, tau=tau).of(robot)
        n, nq = robot.model.nv, robot.model.nq
        parts = ("q", self.q, (n, nq)), ("v", self.v, (n,)), ("tau", self.tau, (n,))
        for name, part, sizes in parts:
            if part is not None and part.shape[1] not in sizes:
                raise LogError(
                    f"{part.shape[1]} columns, and {robot.name} has {n} joints: {names}.",
                    where=self._at(name),
                    hint="Name columns after joints, or choose the frame and locked "
                    "joints so that these are its joints.",
                )
        return self

    def configurations(self, robot: Robot) -> np.ndarray:
        """Return q (N, nq) as Pinocchio has it; NaN where a joint was not measured."""
        model: pin.Model = robot.model
        if self.q.shape[1] == model.nq:
            return self.q
        found = np.full((len(self.q), model.nq), np.nan)
        for k in np.flatnonzero(np.isfinite(self.q).all(axis=1)):
            found[k] = configuration_from_angles(model, self.q[k])
        return found

    def of_its_own_clock(self) -> Log:
        """Return the log with times from its first sample on, where they count from 1970 or so."""
        if not len(self.t) or not self.t[0] > _EPOCH:
            return self
        x_time = None if self.x_time is None else self.x_time - self.t[0]
        return replace(self, t=self.t - self.t[0], x_time=x_time)

    def after(self, t: float) -> Log:
        """Return what was recorded from a time [s] on."""
        kept = self.t >= t
        seen = None if self.x_time is None else self.x_time >= t
        x = None if self.x is None else self.x[kept if seen is None else seen]
        x_time = None if self.x_time is None or seen is None else self.x_time[seen]
        v = None if self.v is None else self.v[kept]
        return replace(
            self, t=self.t[kept], q=self.q[kept], tau=self.tau[kept], v=v, x=x, x_time=x_time
        )

    def _column(self, joint: str) -> int:
        if joint not in self.joints:
            raise LogError(
                f"the robot's joint '{joint}' is not in it; there are {list(self.joints)}."
                f"{did_you_mean(joint, self.joints)}",
                where=self.source,
                hint="Lock what did not move (--lock), choose another frame, or rename columns.",
            )
        return self.joints.index(joint)

    def _at(self, name: str) -> str:
        return f"{self.source}: {name}"

    def _array(self, given: object, name: str, dimensions: int) -> np.ndarray:
        try:
            array = np.array(given, dtype=float)
        except (TypeError, ValueError) as error:
            raise LogError(f"expected numbers: {error}.", where=self._at(name)) from error
        if array.ndim != dimensions:
            shape = "one number a sample" if dimensions == 1 else "a row of numbers a sample"
            raise LogError(f"expected {shape}, got shape {array.shape}.", where=self._at(name))
        return array
