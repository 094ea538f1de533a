"""Tasks of frames of the robot: some or all coordinates of their positions, or their poses."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from .._checks import positive, vector
from ..exceptions import InputError
from .task import Display, Moving, RowGroup, Task


def quaternion(R: np.ndarray) -> np.ndarray:
    """Return a rotation matrix (3, 3) as a unit quaternion xyzw (4); its sign is arbitrary."""
    return pin.Quaternion(R).coeffs()


def _quaternion(q: np.ndarray) -> pin.Quaternion:
    """Return the unit quaternion along q (4), xyzw, of any length but zero."""
    return pin.Quaternion(np.asarray(q, dtype=float)).normalized()


def matrix(q: np.ndarray) -> np.ndarray:
    """Return the rotation matrix (3, 3) of a quaternion xyzw (4) of any length but zero."""
    return _quaternion(q).toRotationMatrix()


def turned(q: np.ndarray, phi: np.ndarray) -> np.ndarray:
    """Return the quaternion (4) of exp(phi) R: q (4) turned by phi (3) [rad] in world axes."""
    turn = pin.Quaternion(pin.exp3_quat(np.asarray(phi, dtype=float)))
    return (turn * _quaternion(q)).normalized().coeffs()


def rotation_between(q: np.ndarray, q_d: np.ndarray) -> np.ndarray:
    """Return phi (3) [rad], |phi| <= pi, exp(phi) = R R_d^T, for quaternions xyzw of R, R_d."""
    return pin.log3(_quaternion(q) * _quaternion(q_d).conjugate())


def rotation_drift(phi: np.ndarray, omega: np.ndarray, omega_d: np.ndarray) -> np.ndarray:
    """Return dphi/dt - (omega - omega_d) (3) [rad/s] for exp(phi) = R R_d^T.

    E = R R_d^T has the angular velocity omega - E omega_d, and with the right Jacobian Jr of phi
    dphi/dt = Jr^-T omega - Jr^-1 omega_d. As Jr^-1 phi = Jr^-T phi = phi, the difference is
    orthogonal to phi: phi^T dphi/dt = phi^T (omega - omega_d).
    """
    inverse = pin.Jlog3(pin.exp3(phi))
    return inverse.T @ omega - inverse @ omega_d - (omega - omega_d)


def joined(parts: Sequence[np.ndarray], positions: int) -> np.ndarray:
    """Return coordinates or rows of several frames, given those of each, positions first."""
    return np.concatenate([part[:positions] for part in parts] + [p[positions:] for p in parts])


def parts_of(x: np.ndarray, count: int, positions: int) -> Iterator[np.ndarray]:
    """Yield the coordinates of each of so many frames, the first so many of each positions."""
    first = count * positions
    rest = (len(x) - first) // count
    for k in range(count):
        places = x[k * positions : (k + 1) * positions]
        yield np.concatenate([places, x[first + k * rest : first + (k + 1) * rest]])


IMAGE, COM = "image", "com"


@dataclass(frozen=True)
class FrameTask(Task):
    """Coordinates of the task frame, or the same ones of each of several frames, in world axes.

    Of several frames x are the positions of all, in the order of the frames, then, for poses, their
    quaternions in the same order; errors, velocities and accelerations are the linear rows of all
    frames, then the angular ones. Frames have priority in their order, see ``RightInverse``.

    Attributes:
        rows: rows of each frame's LOCAL_WORLD_ALIGNED Jacobian, linear before angular.
    """

    rows: slice

    def of_frames(self, frames: Mapping[str, int]) -> FrameTask:
        """Return this task of several frames, name -> index in the model."""
        own = [np.array([f"{frame}.{label}" for label in self.labels]) for frame in frames]
        labels = tuple(joined(own, self.positions).tolist())
        return replace(self, labels=labels, frames=dict(frames))

    @property
    def count(self) -> int:
        """Number k of frames."""
        return len(self.frames) or 1

    @cached_property
    def positions(self) -> int:
        """All rows, but those of rotations."""
        return self.size if self.rows.stop <= 3 else self.size // 2

    @cached_property
    def levels(self) -> np.ndarray:
        """The place of each row's frame (m)."""
        k = self.count
        return joined([np.full(self.size // k, float(i)) for i in range(k)], self.positions // k)

    @cached_property
    def place(self) -> slice:
        """Rows of the frame's position."""
        return slice(self.rows.start, min(self.rows.stop, 3), self.rows.step)

    @abstractmethod
    def of(self, placement: pin.SE3) -> np.ndarray:
        """Return the coordinates x of a frame's placement in the world."""

    def moving(self, placement: pin.SE3, J: np.ndarray) -> Moving:
        """Return x and ``jacobian`` of a frame; of its motion (6) the task velocity (m)."""
        return self.of(placement), self.jacobian(placement, J)

    def jacobian(self, placement: pin.SE3, J: np.ndarray) -> np.ndarray:
        """Return the task Jacobian (m, n), J (6, n) the LOCAL_WORLD_ALIGNED one of the frame.

        Of a motion (6) of the frame the task velocity (m).
        """
        return J[self.rows]

    def linear_map(
        self, model: pin.Model, data: pin.Data, frame: int, q: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the coordinates x and the task Jacobian (m, nv) at q (nq)."""
        pin.computeJointJacobians(model, data, q)
        return self._of_frames(model, data, frame, pin.getFrameJacobian)

    def motion(
        self, model: pin.Model, data: pin.Data, frame: int, q: np.ndarray, v: np.ndarray
    ) -> Moving:
        """Return the coordinates x and the task velocity (m) at q (nq) and v (nv)."""
        pin.forwardKinematics(model, data, q, v)
        return self._of_frames(model, data, frame, lambda *own: pin.getFrameVelocity(*own).vector)

    def _of_frames(
        self, model: pin.Model, data: pin.Data, frame: int, moved: Callable[..., np.ndarray]
    ) -> Moving:
        """Return x and task rows of all frames; without names, of this one.

        ``moved`` is a function of Pinocchio that returns the Jacobian or the motion of a frame.
        """
        found = []
        for own in self.frames.values() or (frame,):
            placement = pin.updateFramePlacement(model, data, own)
            found.append(self.moving(placement, moved(model, data, own, pin.LOCAL_WORLD_ALIGNED)))
        if not self.frames:
            return found[0]
        positions = self.positions // self.count
        x, rows = (joined(parts, positions) for parts in zip(*found, strict=True))
        return x, rows


@dataclass(frozen=True)
class PositionTask(FrameTask):
    """Two or three coordinates of the position [m] of each frame, in world axes."""

    @property
    def groups(self) -> tuple[RowGroup, ...]:
        """One group: the position."""
        return (RowGroup("position", "m", slice(0, self.size)),)

    def of(self, placement: pin.SE3) -> np.ndarray:
        """Return the coordinates x (m) of a frame's placement in the world."""
        return np.array(placement.translation[self.place])


@dataclass(frozen=True)
class PoseTask(FrameTask):
    """Position and orientation: 3 position rows, then 3 rotation rows, all in world axes.

    x and x_d are 7 numbers: position [m] and unit quaternion xyzw of the frame (R_d: of the desired
    frame). Velocities and accelerations are 6: linear [m/s], then angular [rad/s]. The error is dx
    = (p - p_d, phi), phi = log(R R_d^T) [rad].

    Proofs. The derivative of phi is not omega - omega_d, but the difference delta = dphi/dt -
    (omega - omega_d) is known: it depends on phi, omega_d and omega = J_omega qd only. J_omega
    contains no translation, so delta contains no estimate, and the laws cancel it in their closed
    loops. In dV/dt it vanishes because phi^T delta = 0, provided that K multiplies phi by a scalar.
    Gains on the rotation rows must therefore be multiples of the identity, without coupling to the
    position rows; others are refused. V and dV/dt of each law then hold unchanged. Unknown
    translations are learned from the position rows; the rotation rows of Y_k are zero.

    Initial estimates. The inertia of a wrist may be a small part of its load's. Laws that command
    M_hat v then command too little torque on the rotation rows until the load is learned: start
    from an estimate with a load, rather too heavy than too light.

    Region. phi jumps at |phi| = pi, half a turn off, so the proofs hold in |phi| < pi. Let V >= k
    phi^T phi / 2. If V(0) < k pi^2 / 2, the loop stays inside because V does not grow.
    """

    @property
    def coordinates(self) -> int:
        """A position and a quaternion of each frame."""
        return 7 * self.count

    @property
    def groups(self) -> tuple[RowGroup, ...]:
        """Position, then rotation."""
        p = self.lengths
        return RowGroup("position", "m", slice(0, p)), RowGroup("rotation", "rad", slice(p, 2 * p))

    @cached_property
    def _quaternions(self) -> list[slice]:
        """Where each frame's quaternion is among the coordinates."""
        return [slice(i, i + 4) for i in range(self.lengths, self.coordinates, 4)]

    @cached_property
    def _angular(self) -> list[slice]:
        """Where each frame's rotation is among the rows of errors and velocities."""
        return [slice(i, i + 3) for i in range(self.lengths, self.size, 3)]

    def of(self, placement: pin.SE3) -> np.ndarray:
        """Return position [m] and quaternion xyzw, of either sign, (7) of a frame's placement."""
        return np.array(pin.SE3ToXYZQUAT(placement))

    def error(self, x: np.ndarray, x_d: np.ndarray) -> np.ndarray:
        """Return dx = (p - p_d, phi); phi is NaN for quaternions off unit length by 1 %."""
        flawed = self.flaw(x) or self.flaw(x_d)  # the step refuses what is not finite
        p = self.lengths
        phi = [
            np.full(3, np.nan) if flawed else rotation_between(x[q], x_d[q])
            for q in self._quaternions
        ]
        return np.concatenate([x[:p] - x_d[:p], *phi])

    def drift(self, dx: np.ndarray, xd_hat: np.ndarray, xd_d: np.ndarray) -> np.ndarray:
        """Return delta: zero, then dphi/dt - (omega - omega_d) [rad/s], omega = J_omega qd."""
        drifts = [rotation_drift(dx[w], xd_hat[w], xd_d[w]) for w in self._angular]
        return np.concatenate([np.zeros(self.lengths), *drifts])

    def turn(
        self,
        x_hat: np.ndarray,
        x: np.ndarray,
        before: np.ndarray | None = None,
        share: float = 0.0,
    ) -> np.ndarray:
        """Return R_hat^T R of estimated and measured poses, as quaternions xyzw (k, 4).

        With others ``before``, they are those at this share of the way to these.
        """
        turns = []
        for k, q in enumerate(self._quaternions):
            turn = _quaternion(x_hat[q]).conjugate() * _quaternion(x[q])
            if before is not None:
                turn = turn.normalized().slerp(share, _quaternion(before[k]))
            turns.append(turn.coeffs())
        return np.array(turns)

    def carried(self, x_hat: np.ndarray, epsilon: np.ndarray, turn: np.ndarray) -> np.ndarray:
        """Return the poses at x_hat - epsilon [m], rotated by ``turn`` (k, 4) in their own axes."""
        both = zip(self._quaternions, turn, strict=True)
        carried = [_quaternion(x_hat[q]) * _quaternion(by) for q, by in both]
        orientations = [each.normalized().coeffs() for each in carried]
        return np.concatenate([x_hat[: self.lengths] - epsilon, *orientations])

    def moved(self, x: np.ndarray, by: np.ndarray) -> np.ndarray:
        """Return the poses displaced by linear rows [m] and turned by angular ones [rad]."""
        p = self.lengths
        both = zip(self._quaternions, self._angular, strict=True)
        return np.concatenate([x[:p] + by[:p], *(turned(x[q], by[w]) for q, w in both)])

    def flaw(self, x: np.ndarray) -> str | None:
        """Return what is wrong with a quaternion whose length is off 1 by over 1 %, or None."""
        for place in self._quaternions:
            q = x[place]
            if not abs(q.dot(q) - 1.0) < 0.02:
                return f"has a quaternion xyzw of length {np.linalg.norm(q):.4g} instead of 1"
        return None


@dataclass(frozen=True)
class ImageTask(PositionTask):
    """Coordinates of the frame's picture in fixed cameras, y = H_12 (p, 1) / h_3 (p, 1).

    A pixel counts as some length [m], about that which it covers at the arm: y is then as large as
    the motion that it shows, which is what lengths in gains and checks are compared with. A factor
    of five does not matter.

    Attributes:
        cameras: one or two matrices H (3, 4), as nested tuples: the projections from the axes of
            the base to homogeneous coordinates of the images; of the robot that a controller is
            made for, its initial estimate.
        pixel: length [m] that a pixel counts as, in which results are shown in pixels; None: they
            are shown in millimetres.
    """

    cameras: tuple[tuple[tuple[float, ...], ...], ...]
    pixel: float | None = None

    @classmethod
    def seen_by(
        cls, task: FrameTask, cameras: Sequence[np.ndarray], pixel: float | None = None
    ) -> ImageTask:
        """Return the picture of a frame, whose ``task`` is that of the same robot so far."""
        labels = ("u", "v", "u_2")[: 2 * len(cameras)]
        given = tuple(tuple(map(tuple, H.tolist())) for H in cameras)
        return cls(IMAGE, labels, task.rows, given, pixel)

    @property
    def groups(self) -> tuple[RowGroup, ...]:
        """One group: the picture, in pixels where it is known how long they count."""
        shown = None if self.pixel is None else Display("px", 1.0 / self.pixel)
        return (RowGroup("picture", "m", slice(0, self.size), shown),)

    @property
    def picks(self) -> tuple[tuple[int, int], ...]:
        """Camera and row of H of each coordinate: both of the first, one of the second camera."""
        return ((0, 0), (0, 1), (1, 0))[: self.size]

    @cached_property
    def projections(self) -> tuple[np.ndarray, np.ndarray]:
        """Rows (m, 4) of H that give z y of each coordinate, and those that give its depth z."""
        H = np.array(self.cameras)
        cameras, rows = zip(*self.picks, strict=True)
        return H[cameras, rows], H[cameras, 2]

    def of(self, placement: pin.SE3) -> np.ndarray:
        """Return the coordinates y (m) of a frame's placement in the axes of the base."""
        above, below = (H[:, :3] @ placement.translation + H[:, 3] for H in self.projections)
        return above / below

    def nearest(self, p: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return the point (3) near p (3) [m], in the axes of the base, whose picture is y (m)."""
        for _ in range(3):  # of Newton's method
            there = pin.SE3(np.eye(3), p)
            J = self.jacobian(there, np.eye(6)[:, :3])
            p = p + np.linalg.pinv(J) @ (y - self.of(there))
        return p

    def distance(self, p: np.ndarray, y_d: np.ndarray) -> float:
        """Return how far p (3) is from the nearest point [m] whose picture is y_d (m)."""
        return float(np.linalg.norm(self.nearest(p, y_d) - p))

    def jacobian(self, placement: pin.SE3, J: np.ndarray) -> np.ndarray:
        """Return dy/dq (m, n), J (6, n) the LOCAL_WORLD_ALIGNED Jacobian, or dy/dt of a motion."""
        y = self.of(placement)
        above, below = self.projections
        z = below[:, :3] @ placement.translation + below[:, 3]
        return (above - y[:, None] * below)[:, :3] / z[:, None] @ J[:3]


@dataclass(frozen=True)
class ComTask(PoseTask):
    """Centre of mass of a robot that stands, and orientation of its task frame, in world axes.

    x and x_d are 7 numbers: centre of mass [m] and unit quaternion xyzw of the frame, with errors,
    velocities and gains as of ``PoseTask``. The centre of mass has priority over the orientation.

    It is that of the moving bodies of the robot as it was loaded. Loads of ``Robot.changed`` and
    what is learned do not move it, so x follows from q alone: it needs no sensors, J is exact, its
    rate contains no estimate, and the proofs are those of known kinematics. Contact forces balance
    the learned bodies; the true centre of mass is off x by what load and description miss.

    Attributes:
        model: the robot as it was loaded; of a recording None.
        frame: index of the task frame in ``model``.
    """

    model: pin.Model | None = field(default=None, compare=False, repr=False)
    frame: int = field(default=0, compare=False)

    positions = 0  # no row is a position of the frame
    lengths = 3  # the centre of mass
    place = slice(0)

    @cached_property
    def levels(self) -> np.ndarray:
        """0 of the centre of mass, 1 of the orientation (6)."""
        return np.repeat([0.0, 1.0], 3)

    def motion(
        self, model: pin.Model, data: pin.Data, frame: int, q: np.ndarray, v: np.ndarray
    ) -> Moving:
        """Return the coordinates x (7) and the task velocity (6) at q (nq) and v (nv)."""
        x, J, _ = self.moving_map(data, q, v)
        return x, J.dot(v)

    def measured(self, x: np.ndarray | None, q: np.ndarray) -> np.ndarray:
        """Return the coordinates (7) of the measured q (nq); x is not used."""
        assert self.model is not None
        return self.at(self.model, self.model.createData(), self.frame, q)

    def linear_map(
        self, model: pin.Model, data: pin.Data, frame: int, q: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the coordinates x (7) and the task Jacobian (6, nv) at q (nq)."""
        return self.moving_map(data, q, np.zeros(model.nv))[:2]

    def moving_map(
        self, data: pin.Data, q: np.ndarray, v: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return x (7), J (6, nv) and dJ/dt (6, nv) at q (nq) and v (nv); data is scratch."""
        given = self.model, data, self.frame
        pin.dccrba(self.model, data, q, v)  # the linear momentum is m J_com v
        turned = quaternion(pin.updateFramePlacement(*given).rotation)
        J = pin.getFrameJacobian(*given, pin.LOCAL_WORLD_ALIGNED)
        J_rate = pin.getFrameJacobianTimeVariation(*given, pin.LOCAL_WORLD_ALIGNED)
        J[:3] = data.Ag[:3] / data.Ig.mass
        J_rate[:3] = data.dAg[:3] / data.Ig.mass
        return np.append(data.com[0], turned), J, J_rate


def pinhole_camera(
    position: ArrayLike,
    target: ArrayLike,
    focal: float = 1000.0,
    *,
    centre: ArrayLike = (0.0, 0.0),
    roll: float = 0.0,
) -> np.ndarray:
    """Return the projection (3, 4) of a camera that looks at a point, for ``Robot.filmed_by``.

    u counts to the right in the picture and v downwards, which is along -z in the axes of the base;
    of a camera that looks straight up or down it is along -y.

    Args:
        position: (3) of the camera [m], in the axes of the base.
        target: (3) the point that it looks at [m].
        focal: focal length [pixels].
        centre: (2) u and v [pixels] of that point.
        roll: by which the camera is turned about its line of sight [rad], the picture then turns
            the other way.

    Raises:
        InputError: wrong sizes, a focal length that is not positive, or a target where the camera
            stands.
    """
    eye = vector(position, 3, "position", fills=False)
    at = vector(target, 3, "target", fills=False)
    u, v = vector(centre, 2, "centre", fills=False)
    (turn,) = vector(roll, 1, "roll")
    f = positive(focal, "focal", error=InputError)
    away = np.linalg.norm(at - eye)
    if not away > 0.0:
        raise InputError("the camera looks at the point where it stands.", where="target")
    forward = (at - eye) / away
    upright = abs(forward[2]) > 0.999  # straight up or down
    right = np.cross(forward, np.eye(3)[1 if upright else 2])
    right /= np.linalg.norm(right)
    R = pin.exp3(np.array([0.0, 0.0, -turn])) @ np.array([right, np.cross(forward, right), forward])
    K = np.array([[f, 0.0, u], [0.0, f, v], [0.0, 0.0, 1.0]])
    return K @ np.column_stack([R, -R @ eye])


def _position_task(name: str) -> FrameTask:
    """Return the task of the coordinates of the position that are the letters of a name."""
    rows = ["xyz".index(letter) for letter in name]
    return PositionTask(name, tuple(name), slice(rows[0], rows[-1] + 1, rows[1] - rows[0]))


_POSE = "x", "y", "z", "phi_x", "phi_y", "phi_z"
TASKS: dict[str, FrameTask] = {
    **{name: _position_task(name) for name in ("xy", "xz", "yz", "xyz")},
    "pose": PoseTask("pose", _POSE, slice(6)),
    COM: ComTask(COM, _POSE, slice(6)),
}
"""The tasks of a frame by name, and that of the centre of mass, of no robot yet."""
