"""Unknown sensor frame: a small excitation at the start estimates it, while the joints are held.

While the rotation between the axes of x and the robot's base is unknown, a feedback of x may drive
the arm away from the path; a feedback of the joints cannot. So the same law holds the joints, with
the joints as its task and a V of its own, and learns the load. The frame moves to the corners of a
tetrahedron within a small ball about its place. The measured frames give the kinematic estimate by
least squares, whose prediction error is linear at any estimate. The path begins when the predicted
velocity of the frame is accurate enough in every direction.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..adaptation.adaptation import Estimate, Frozen
from ..adaptation.projections import BoxProjection
from ..models.delay_compensation import SensedState
from ..models.physical_fit import sums_of
from ..models.task_kinematics import JointKinematics
from ..models.tracker_kinematics import TrackerKinematics
from ..records import Camera, Desired, Measurement
from ..signals import Signals
from ..trajectories.trajectory import LONGEST_RAMP, Waypoints
from .controller import Controller, predicted_at_rest
from .governor import PathTime
from .state import ControllerState

AXES = "unknown axes"  # the cause for which the path waits
# Of the reach: farthest that the frame moves. Half: with noisy frames a UR5's path does not begin;
# twice: after 7 s in place of 22, moved twice as far.
_BALL = 2.2e-3
# Standard deviation of a predicted velocity, relative to that of the frame. Half: as above; twice:
# after 7 s, and a Z1's largest error is 4.0 % of the radius in place of 2.6.
_KNOWN = 0.03
# [s]; half, twice: after 21 to 24 s, last errors 0.3 to 0.5 % in place of 0.35
_SETTLING, _SEGMENT, _REST = 0.5, 0.64, 0.3
_LEAST_NOISE = 1e-5  # of the reach; half, twice: the same runs


class Start(NamedTuple):
    """What is remembered until the path begins; n joints, m_p positions, p kinematic parameters.

    Attributes:
        q: (nq) where the joints are held.
        ways: (n, 3) joint motion that moves the frame along each axis of the base by one metre, but
            for directions that it hardly moves in, by singular values below a tenth of the largest.
        size: of the motion [m]; zero while the estimates rest.
        filters: state of the filters of the law of the joints.
        taken: time of the last frame [s].
        rows: how many coordinates the frames have.
        sums: (p + 1, p + 1) of (X_k epsilon)^T (X_k epsilon) over the frames, X_k (m_p, p) and the
            prediction error epsilon (m_p) [m] at the estimate that is held until the end.
    """

    q: np.ndarray
    ways: np.ndarray
    size: float
    filters: Any
    taken: float
    rows: int
    sums: np.ndarray

    def variance(self, step: np.ndarray, least: float, fitted: int) -> float:
        """Return the variance of a coordinate of the noise that the residual shows [m^2].

        Args:
            step: (p) from the estimate that is held to the one that has the residual.
            least: standard deviation, at least [m].
            fitted: how many parameters were fitted.
        """
        change = np.append(step, 1.0)
        return max(change @ self.sums @ change / max(1, self.rows - fitted), least**2)


class SlowStart(Controller):
    """A controller that excites the joints by millimetres until the axes of x are known.

    That is where the state begins without a kinematic estimate; with one the path begins at once.
    The frame is to stay within 0.22 % of the reach of its place. A cycle of its motion takes 3.5 s;
    after each one the path begins if the standard deviation of a coordinate of the predicted
    velocity is at most 3 % of the velocity of the frame, in all directions in which the arm can
    move, by the noise that the residual shows. Of a tracker the estimate is then that of the
    rotation, position and translations that explain the frames best, unless these explain them
    badly. The kinematic least squares begins with the information of these frames. Until then the
    time of the path stands still (``PathTime``, cause "unknown axes"). Its rate rises to one in
    5 s, or in less by as much as the velocity is known better: a slow motion has more frames on its
    way.
    Nothing but the joints is held while the estimates rest.

    As one differential equation (``run_continuous``), and under a law that has no feedback of the
    joints (``Law.of_joints``), the path begins at once.
    """

    @cached_property
    def _joints(self) -> Controller | None:
        """The controller that holds the joints, with the same dynamics; None: the law has none."""
        kinematics = JointKinematics(self.kinematics.robot)
        law = self.law.of_joints(kinematics.task)
        if law is None:
            return None
        return Controller(
            law,
            kinematics,
            self.dynamics,
            adaptation_k=Frozen(),
            adaptation_d=self.adaptation_d,
            limits=replace(self.limits, governor=None),
            compensation=self.compensation,
            period=self.period,
        )

    def limited(self, torque: ArrayLike | bool | None) -> Controller:
        """Return this controller with other torque limits; see ``Controller.limited``."""
        other = super().limited(torque)
        vars(other).pop("_joints", None)
        return other

    def init(
        self, measurement: Measurement, *, a_k: np.ndarray | None = None, **given: Any
    ) -> ControllerState:
        """Return the state to start from; see ``Controller.init``."""
        state = super().init(measurement, a_k=a_k, **given)
        joints = self._joints
        if a_k is not None or joints is None:
            return state
        q = state.sensed.q
        robot = self.kinematics.robot
        p = self.kinematics.size
        J = pin.computeFrameJacobian(
            robot.model, robot.model.createData(), q, robot.frame_id, pin.LOCAL_WORLD_ALIGNED
        )
        with joints.reserved():
            filters = joints.law.filters.init(state.sensed, joints.kinematics)
        start = Start(
            q=q,
            ways=np.linalg.pinv(J[:3], rcond=0.1),
            size=0.0,
            filters=filters,
            taken=-math.inf,
            rows=0,
            sums=np.zeros((p + 1, p + 1)),
        )
        return state._replace(start=start, path=PathTime(rate=0.0, cause=AXES))

    def step(
        self, state: ControllerState, measurement: Measurement, desired: Desired, dt: float
    ) -> tuple[np.ndarray, ControllerState]:
        """Return the torque (n) to hold for the next dt [s], and the next state.

        Raises:
            PinadaptError: as ``Controller.step``.
        """
        start = state.start
        joints = self._joints
        path = state.path
        if start is None or joints is None or path is None:
            return super().step(state, measurement, desired, dt)
        # time in the cycle; negative: before the first
        place = math.fmod(path.lag - _SETTLING, self._cycle.settles + self._rest)
        with self.reserved():
            sensed, _, held, _, elapsed = self._sensed(state, measurement, desired, dt)
            t = held.t
            begun = None
            taken = t if sensed.frame is None else sensed.frame.t
            if taken > start.taken and sensed.epsilon.size:
                rests = place - self._cycle.settles - (t - taken)
                first = 0.0 <= rests < taken - start.taken  # frame of this rest
                sums = start.sums + sums_of(sensed.X_k, sensed.epsilon)
                seen = start.rows + sensed.epsilon.size
                start = start._replace(taken=taken, rows=seen, sums=sums)
                if first and state.adapting:
                    begun = self._begun(state, start, measurement)
        if begun is not None:
            return super().step(begun, measurement, desired, dt)
        if not 0.0 <= place < self._cycle.settles:
            start = start._replace(size=_BALL * self.kinematics.robot.reach * state.adapting)
        e, ed, edd = (start.ways.dot(start.size * each) for each in self._cycle.at(place))
        inner = state._replace(
            kinematic=Estimate(np.zeros(0)),
            filters=start.filters,
            adapting=state.adapting and elapsed > 0.0,
            sensed=state.sensed._replace(first=sensed.first),
            path=None,
            start=None,
        )
        held = held._replace(q=sensed.q, v=sensed.v, x=None, x_time=None, xd=None)
        goal = Desired(joints.kinematics.task.measured(None, start.q) + e, ed, edd)
        torque, after = joints.step(inner, held, goal, elapsed or dt)
        return torque, after._replace(
            kinematic=state.kinematic,
            filters=state.filters,
            adapting=state.adapting,
            sensed=sensed._replace(first=after.sensed.first),
            path=path._replace(lag=path.lag + elapsed),
            start=start._replace(filters=after.filters),
        )

    @cached_property
    def _cycle(self) -> Waypoints:
        """A cycle of the frame on the unit sphere, in which each axis is excited as the others."""
        none = np.zeros(3)
        corners = [[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]
        return Waypoints(np.vstack([none, corners, none]) / math.sqrt(3.0), _SEGMENT)

    @cached_property
    def _rest(self) -> float:
        """How long the frame rests after each cycle, for two frames of the camera [s]."""
        camera = self.sensors.camera or Camera()
        return camera.delay + max(_REST, 0.0 if camera.rate is None else 2.0 / camera.rate)

    def _known(self, start: Start, a_k: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """Return the kinematic estimate (p) from the frames, its information (p, p) and error.

        The error is the standard deviation of a predicted velocity, relative to that of the frame.

        Args:
            start: with the frames.
            a_k: (p) the estimate whose prediction errors they are.
        """
        kinematics = self.kinematics
        H = start.sums[:-1, :-1]
        score = start.sums[:-1, -1]
        prior = np.diag(1.0 / kinematics.sizes**2)
        least = _LEAST_NOISE * kinematics.robot.reach
        variance = least**2
        for _ in range(3):  # the variance is that of the residual
            information = H / variance + prior
            found = a_k - np.linalg.solve(information, score) / variance
            variance = start.variance(found - a_k, least, len(a_k))
        uncertain, size = self._uncertain(start, found, np.linalg.inv(information))
        if isinstance(kinematics, TrackerKinematics):
            rigid, of_rigid = kinematics.explaining_tracker(
                H / variance, (H.dot(a_k) - score) / variance, kinematics.tracker(found)
            )
            nearest = kinematics.parameters(rigid)
            of_rigid /= max(1.0, start.variance(nearest - a_k, least, len(of_rigid)) / variance)
            P = kinematics.covariance(rigid, of_rigid)
            other, _ = self._uncertain(start, nearest, P)
            if other < uncertain:
                uncertain = other
                found = nearest
                information = kinematics.information(rigid, of_rigid)
        box = self.adaptation_k
        if isinstance(box, BoxProjection):
            found = np.clip(found, box.low, box.high)
        return found, information, uncertain / max(1.0, size)

    def _uncertain(self, start: Start, a_k: np.ndarray, P: np.ndarray) -> tuple[float, float]:
        """Return the largest standard deviation of a coordinate of a predicted velocity, and size.

        For each of the ways, with an estimate a_k (p) of covariance P (p, p); the size of the
        predicted velocities is relative to that of the arm's.
        """
        kinematics = self.kinematics
        largest = 0.0
        moved = []
        for way in start.ways.T:
            kinematics.update(a_k, start.q, way)
            Y_p = kinematics.Y_p
            largest = max(largest, np.vdot(Y_p.dot(P), Y_p) / len(Y_p))
            moved.append(kinematics.xd_hat[: kinematics.positions])
        axes = min(kinematics.positions, int(np.linalg.matrix_rank(start.ways)))
        return math.sqrt(largest), np.linalg.norm(moved) / math.sqrt(axes)

    def _begun(
        self, state: ControllerState, start: Start, measurement: Measurement
    ) -> ControllerState | None:
        """Return the state with which the path begins, None while it does not.

        The arm is at rest: all frames together give its position, the last one its orientation.
        """
        a_k, information, uncertain = self._known(start, state.a_k)
        if uncertain > _KNOWN:
            return None
        before = state.sensed._replace(x=measurement.x)
        sensed = predicted_at_rest(before, self.kinematics, a_k)
        assert state.path is not None
        return state._replace(
            kinematic=self.adaptation_k.init(a_k, information),
            filters=self._filters.init(sensed, self.kinematics),
            sensed=sensed,
            path=PathTime(state.path.lag, 0.0, _KNOWN / (LONGEST_RAMP * uncertain), AXES),
            start=None,
        )

    def _governed(
        self,
        path: PathTime,
        s: Signals,
        sensed: SensedState,
        torque: np.ndarray,
        elapsed: float | None,
    ) -> PathTime:
        """Return the time of the path after the elapsed time [s], while its rate rises, too."""
        after = super()._governed(path, s, sensed, torque, elapsed)
        if path.cause != AXES or not elapsed:
            return after
        rate = path.rate + path.acceleration * elapsed
        if self.limits.governor is not None and after.rate < rate:
            return after
        lag = path.lag + elapsed * (1.0 - min(1.0, 0.5 * (path.rate + rate)))
        return PathTime(lag) if rate >= 1.0 else path._replace(lag=lag, rate=rate)
