"""Constraints A(q) v = 0: contacts with the ground, loops, joints that follow others."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import compress, product
from typing import Any, TypeAlias, TypeVar

import numpy as np
import pinocchio as pin

from .._checks import ROUNDING, flag, instance, numbers, positive, vector
from ..description.chain import angles_from_configuration, configuration_from_angles, frame_id
from ..exceptions import RobotError
from ..records import Feet
from ..tasks.task import Moving
from .changes import joint_id

_ITERATIONS = 30  # of Newton's method; half or twice: it converges in 10 or not at all
# of the largest row, and [m, rad] by which loops may miss; half or twice: the same rows, as axes
# and anchors written with five digits are off by 1e-5
DEPENDENT = 1e-4
# [s] in which it is forgotten where a contact came down, which creeps by 0.1 mm/s in MuJoCo. Half
# or twice: standing feet of crawls move by at most 2.0 or 3.0 mm in place of 2.4, and feet that
# slip are noticed in the same sample
_FORGOTTEN = 1.0


@dataclass(frozen=True)
class Contact:
    """A point foot or a sole that stands on the ground.

    Attributes:
        frame: its frame; that of a sole has its normal as z axis and lies in its middle.
        sole: half of its length and of its width [m], along the axes x and y of the frame; None
            for a point.
        friction: coefficient.

    Raises:
        RobotError: numbers that are not positive.
    """

    frame: str
    sole: tuple[float, float] | None = None
    friction: float = 0.6

    def __post_init__(self) -> None:
        """Refuse what is no contact."""
        instance(self.frame, str, "contacts.frame", RobotError)
        positive(self.friction, "contacts.friction", error=RobotError)
        if self.sole is not None:
            for half in vector(self.sole, 2, "contacts.sole", error=RobotError, fills=False):
                positive(half, "contacts.sole", error=RobotError)

    @property
    def size(self) -> int:
        """Three rows of a point, six of a sole."""
        return 3 if self.sole is None else 6

    @property
    def corners(self) -> np.ndarray:
        """The corners of the sole (4, 3) in the axes of the frame [m], or the point (1, 3)."""
        sides = [np.unique([-half, half]) for half in self.sole or (0.0, 0.0)]
        return np.array([*product(*sides, [0.0])])

    def places(self, model: pin.Model) -> list[int]:
        """Return the index of the frame."""
        return [frame_id(model, self.frame)]

    def at(self, model: pin.Model, data: pin.Data, at: Sequence[int]) -> Moving:
        """Return the rows: the velocity of the frame, of a sole also its angular velocity."""
        A, A_rate = _frame_rows(model, data, at[0], pin.LOCAL_WORLD_ALIGNED)
        return A[: self.size], A_rate[: self.size]

    def error(self, data: pin.Data, at: Sequence[int], angles: np.ndarray) -> np.ndarray:
        """Return the height, and NaN."""
        off = np.full(self.size, np.nan)
        off[2] = data.oMf[at[0]].translation[2]
        return off


@dataclass(frozen=True)
class Loop:
    """Two frames that move as one body: a linkage that is closed, or two arms with one object.

    Attributes:
        frame_a, frame_b: the frames.
        rows: which of the relative velocities of the two bodies at frame a are zero, 0 to 2 linear
            and 3 to 5 angular, in the axes of frame a. The robot keeps those that are independent
            at its home pose, see ``independent``; of a planar loop two linear ones.
        closed: whether the frames meet; if not they keep the places to each other that they have at
            the home pose, as two grippers on one object do.
        squeeze: force with which they are pushed towards each other [N], negative to pull; None:
            whatever takes the least torques of the motors.

    Raises:
        RobotError: one frame twice, rows that do not exist, or a squeeze of frames that meet.
    """

    frame_a: str
    frame_b: str
    rows: tuple[int, ...] = (0, 1, 2)
    closed: bool = True
    squeeze: float | None = None

    def __post_init__(self) -> None:
        """Refuse what is no loop."""
        if self.frame_a == self.frame_b:
            raise RobotError(f"'{self.frame_a}' is both frames.", where="loops.frame_b")
        if not self.rows or not set(self.rows) <= set(range(6)):
            raise RobotError("expected some of 0 to 5.", where="loops.rows")
        flag(self.closed, "loops.closed")
        if self.squeeze is not None:
            numbers(self.squeeze, "loops.squeeze", error=RobotError)
            if self.closed or not {0, 1, 2} <= set(self.rows):
                raise RobotError(
                    "is along the line between frames that do not meet, and all rows 0 to 2.",
                    where="loops.squeeze",
                )

    @property
    def size(self) -> int:
        """Number of rows."""
        return len(self.rows)

    def places(self, model: pin.Model) -> list[int]:
        """Return the indices of both frames."""
        return [frame_id(model, name) for name in (self.frame_a, self.frame_b)]

    def at(self, model: pin.Model, data: pin.Data, at: Sequence[int]) -> Moving:
        """Return the rows of the velocity of b's body at frame a, less that of frame a."""
        (A_a, rate_a), (A_b, rate_b) = (_frame_rows(model, data, each, pin.LOCAL) for each in at)
        v_a, v_b = (pin.getFrameVelocity(model, data, each, pin.LOCAL) for each in at)
        b = data.oMf[at[0]].actInv(data.oMf[at[1]])  # in the axes of a
        A = b.action @ A_b - A_a
        A_rate = b.action @ (rate_b + (v_b - b.actInv(v_a)).action @ A_b) - rate_a
        rows = list(self.rows)
        return A[rows], A_rate[rows]

    def error(self, data: pin.Data, at: Sequence[int], angles: np.ndarray) -> np.ndarray:
        """Return the way and the turn from a to b; NaN where they do not meet."""
        if not self.closed:
            return np.full(self.size, np.nan)
        off = data.oMf[at[0]].actInv(data.oMf[at[1]])
        return np.concatenate([off.translation, pin.log3(off.rotation)])[list(self.rows)]


@dataclass(frozen=True)
class Coupling:
    """A joint that follows another one, q_j = ratio q_i + offset; it has no motor.

    Attributes:
        joint: that follows.
        leader: the other one.
        ratio: of their velocities.
        offset: [rad or m].
    """

    joint: str
    leader: str
    ratio: float = 1.0
    offset: float = 0.0

    size = 1

    def __post_init__(self) -> None:
        """Refuse what is no number."""
        numbers([self.ratio, self.offset], "mimic", error=RobotError)

    def places(self, model: pin.Model) -> list[int]:
        """Return the places in v of the joint and of the one that it follows."""
        return [joint_id(model, name, "mimic") - 1 for name in (self.joint, self.leader)]

    def at(self, model: pin.Model, data: pin.Data, at: Sequence[int]) -> Moving:
        """Return one constant row."""
        A = np.zeros((1, model.nv))
        A[0, at] = 1.0, -self.ratio
        return A, np.zeros(A.shape)

    def error(self, data: pin.Data, at: Sequence[int], angles: np.ndarray) -> np.ndarray:
        """Return q_j - ratio q_i - offset."""
        own, other = angles[at]
        return np.array([own - self.ratio * other - self.offset])


Constraint: TypeAlias = Contact | Loop | Coupling
"""Some rows of A: ``size`` of them, ``places`` of its frames in a model, or of its joints in v.

``at`` returns the rows, with Jacobians, their variation and frames in ``data``; ``error`` by how
much each row is off at joint positions (n), NaN where any value will do.
"""
Part = TypeVar("Part", Contact, Loop)


def parts_of(
    kind: type[Part], given: Iterable[Part | Mapping[str, Any] | str], where: str
) -> tuple[Part, ...]:
    """Return contacts or loops, given as such, by their fields or, contacts, by their frames.

    Raises:
        RobotError: something else.
    """
    found = []
    given = [given] if isinstance(given, str) else instance(given, Iterable, where, RobotError)
    for each in given:
        own: Any = {"frame": each} if isinstance(each, str) else each
        if isinstance(own, Mapping):
            try:
                lists = {name: tuple(x) for name, x in own.items() if isinstance(x, list)}
                own = kind(**{**own, **lists})
            except TypeError as error:
                raise RobotError(f"{error}.", where=where) from error
        found.append(instance(own, kind, where, RobotError))
    return tuple(found)


def _frame_rows(model: pin.Model, data: pin.Data, frame: int, axes: pin.ReferenceFrame) -> Moving:
    """Return the Jacobian (6, n) of a frame in world axes or its own, and its rate."""
    given = model, data, frame, axes
    return pin.getFrameJacobian(*given), pin.getFrameJacobianTimeVariation(*given)


def consistent(model: pin.Model, q: np.ndarray, parts: Sequence[Constraint]) -> np.ndarray:
    """Return the configuration (nq) next to q (nq) at which all constraints hold.

    Contacts stand on the ground, at a height of zero, wherever else they are.

    Raises:
        RobotError: loops that do not close near q.
    """
    if not parts:
        return q
    constraints = Constraints(model, parts)
    angles = angles_from_configuration(model, q)
    for part, at in constraints.placed:
        if isinstance(part, Coupling):  # its leader stays
            angles[at[0]] -= part.error(constraints.data, at, angles)[0]
    q = configuration_from_angles(model, angles)
    for _ in range(_ITERATIONS):
        A = constraints.jacobian(q)
        angles = angles_from_configuration(model, q)
        each = [part.error(constraints.data, at, angles) for part, at in constraints.placed]
        off = np.concatenate(each)
        A = A[np.isfinite(off)]
        off = off[np.isfinite(off)]
        step = -np.linalg.pinv(A, rcond=DEPENDENT) @ off
        left = np.abs(A @ step).max(initial=0.0)  # of what the joints can change
        if left < ROUNDING * DEPENDENT and np.abs(off).max(initial=0.0) < DEPENDENT:
            return q
        q = pin.integrate(model, q, step)
    raise RobotError(
        "the loops do not close near the home pose.", where="loops", hint="Give a q0 nearer."
    )


def repeated(P: np.ndarray) -> float:
    """Return the root of n over the rank of a projection P (n, n), as of ``Constraints.free``.

    The noise of n independent signals is that of the projected ones times this number.
    """
    return float(np.sqrt(len(P) / np.trace(P)))


def independent(
    model: pin.Model, q: np.ndarray, parts: Sequence[Constraint]
) -> tuple[Constraint, ...]:
    """Return constraints without the rows of loops that follow from others at q (nq).

    Rows of loops are taken one by one, beside all rows of other constraints: always the one that
    differs most from what those taken imply, until what is left is below 1e-4 of the largest row.
    At a singular q that leaves out too much.
    """
    loops = [isinstance(part, Loop) for part in parts]
    if not any(loops):
        return tuple(parts)
    from scipy.linalg import qr  # here, because few robots have loops

    A = Constraints(model, parts).jacobian(q)
    sizes = [part.size for part in parts]
    others = A[~np.repeat(loops, sizes)]
    rest = A - A @ np.linalg.pinv(others, rcond=DEPENDENT) @ others
    R, order = qr(rest.T, mode="r", pivoting=True)
    least = DEPENDENT * np.linalg.norm(A, axis=1).max()
    taken = np.isin(np.arange(len(A)), order[: len(R)][np.abs(np.diag(R)) > least])
    kept = list[Constraint]()
    for part, own in zip(parts, np.split(taken, np.cumsum(sizes)[:-1]), strict=True):
        if not isinstance(part, Loop):
            kept.append(part)
        elif own.any():
            kept.append(replace(part, rows=tuple(compress(part.rows, own))))
    return tuple(kept)


class Constraints:
    """All constraints of a robot: A (k, n) and its rate.

    Attributes:
        parts: the constraints.
        placed: each with the indices of its frames, or of its joints in v.
        data: scratch, with the frames of the last ``at``.
    """

    def __init__(self, model: pin.Model, parts: Sequence[Constraint]) -> None:
        """Take the model of a robot, and its constraints."""
        self._model = model.copy()
        self.data = model.createData()
        self.parts = tuple(parts)
        self._none = np.zeros((0, model.nv))
        self._last = (np.full(model.nq, np.nan), np.zeros(model.nv)), (self._none, self._none)
        self.placed = [(part, part.places(model)) for part in self.parts]
        self._feet = [at[0] for part, at in self.placed if isinstance(part, Contact)]

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy by the arguments: Pinocchio's data is scratch."""
        return type(self), (self._model, self.parts)

    def at(self, q: np.ndarray, v: np.ndarray) -> Moving:
        """Return A (k, n) and dA/dt (k, n) at q (nq) and v (n), kept for the next call there."""
        (q_last, v_last), rows = self._last
        if (q == q_last).all() and (v == v_last).all():
            return rows
        model = self._model
        data = self.data
        pin.computeJointJacobiansTimeVariation(model, data, q, v)
        pin.updateFramePlacements(model, data)
        own = (part.at(model, data, at) for part, at in self.placed)
        found = [(self._none, self._none), *own]
        A, A_rate = map(np.concatenate, zip(*found, strict=True))
        self._last = (q.copy(), v.copy()), (A, A_rate)
        return A, A_rate

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """Return A (k, n) at q (nq)."""
        (_, v_last), _ = self._last
        return self.at(q, v_last)[0]

    def holding(self, stands: np.ndarray | None) -> np.ndarray:
        """Return which rows (k) of A hold: all but those of feet in the air.

        ``stands`` (c) says which contacts stand, the last of the constraints, points all of them;
        None: all.
        """
        holds = np.ones(sum(part.size for part in self.parts), dtype=bool)
        if stands is not None:
            holds[len(holds) - 3 * len(stands) :] = np.repeat(stands, 3)
        return holds

    def free(self, q: np.ndarray, v: np.ndarray, stands: np.ndarray | None = None) -> Moving:
        """Return P = I - A^+ A (n, n) and dP/dt (n, n), A the rows that hold.

        P A^T = 0: of a torque, P leaves what no constraint force changes.
        """
        if not self.parts:
            return np.eye(v.size), np.zeros((v.size, v.size))
        A, A_rate = self.at(q, v)
        if stands is not None:
            holds = self.holding(stands)
            A = A[holds]
            A_rate = A_rate[holds]
        U, sizes, V = np.linalg.svd(A, full_matrices=False)
        rank = np.count_nonzero(sizes > np.finfo(float).eps * sizes.max(initial=0.0))
        U = U[:, :rank]
        sizes = sizes[:rank]
        V = V[:rank]
        P = np.eye(v.size) - V.T.dot(V)
        turning = (V.T / sizes).dot(U.T.dot(A_rate)).dot(P)  # A^+ = V^T / sizes U^T
        return P, -turning - turning.T

    def project_momentum(
        self,
        M: np.ndarray,
        F: np.ndarray,
        q: np.ndarray,
        v: np.ndarray,
        stands: np.ndarray | None = None,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return P M, P F - dP/dt M (n, c) and P, for d/dt (M a) + F a = tau to hold for P tau."""
        P, P_rate = self.free(q, v, stands)
        return P.dot(M), P.dot(F) - P_rate.dot(M), P

    def squeezes(self, size: int) -> Moving:
        """Return rows E (c, size) and numbers e (c) of the chosen squeezes: E f = e.

        The frames are those of the last ``at``; the loops are the first of the constraints.
        """
        rows = []
        squeezes = []
        first = 0
        for part, frames in self.placed:
            if isinstance(part, Loop) and part.squeeze is not None:
                a, b = (self.data.oMf[frame] for frame in frames)
                way = a.actInv(b).translation
                row = np.zeros(size)
                row[[first + part.rows.index(i) for i in range(3)]] = way / np.linalg.norm(way)
                rows.append(row)
                squeezes.append(part.squeeze)
            first += part.size
        return np.array(rows).reshape(len(rows), size), np.array(squeezes)

    def references(self, feet: Feet, v: np.ndarray, alpha: float) -> Moving:
        """Return what A v_r (k) shall be, and its rate (k): zero where the robot stands.

        That of a foot in the air is xd_d - alpha (x - x_d). All contacts are points, and they are
        the last of the constraints. State and frames are those of the last ``at``.

        Args:
            feet: their motion.
            v: (n) velocity.
            alpha: [1/s].
        """
        A, _ = self._last[1]
        both = np.zeros((2, len(A)))
        own = slice(len(A) - 3 * len(self._feet), None)
        u = feet.xd_d - alpha * (self.feet - feet.x_d)
        ud = feet.xdd_d - alpha * ((A[own] @ v).reshape(-1, 3) - feet.xd_d)
        both[:, own] = np.where(feet.stands[:, None], 0.0, [u, ud]).reshape(2, -1)
        return both[0], both[1]

    @property
    def placements(self) -> list[pin.SE3]:
        """The placements of the contacts in the world, of the last ``at``."""
        return [self.data.oMf[foot] for foot in self._feet]

    @property
    def feet(self) -> np.ndarray:
        """Where the contacts are (c, 3) [m], of the last ``at``."""
        return np.array([place.translation for place in self.placements]).reshape(-1, 3)

    def footing(
        self, before: np.ndarray, stands: np.ndarray | None, dt: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return where contacts stand (c, 3), and how far each has moved since (c) [m].

        That is where a contact came down, forgotten slowly, as contacts creep; NaN in the air,
        where nothing counts as moved. Frames are those of the last ``at``.

        Args:
            before: (c, 3) of the sample before; empty at first.
            stands: (c) which contacts stand; None: all.
            dt: time since then [s].
        """
        x = self.feet
        old = np.where(np.isnan(before), x, before) if len(before) else x
        if stands is not None:
            old = np.where(stands[:, None], old, np.nan)
        way = x - old
        moved = np.nan_to_num(np.linalg.norm(way, axis=1))
        return old + way * (dt / _FORGOTTEN), moved
