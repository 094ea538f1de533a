"""Models: the estimated kinematics and dynamics of a robot, linear in unknown parameters."""

from .basis import BaseParameters as BaseParameters
from .basis import BasisDynamics as BasisDynamics
from .basis import LumpedDynamics as LumpedDynamics
from .basis import base_parameters as base_parameters
from .bodies import BodyDynamics as BodyDynamics
from .camera_kinematics import CameraKinematics as CameraKinematics
from .delay_compensation import DelayCompensator as DelayCompensator
from .delay_compensation import SensedState as SensedState
from .dynamics import Dynamics as Dynamics
from .dynamics import StackedDynamics as StackedDynamics
from .joint_effects import JointEffects as JointEffects
from .linear_kinematics import FrameKinematics as FrameKinematics
from .regressor import Momentum as Momentum
from .regressor import Regressor as Regressor
from .task_kinematics import ComKinematics as ComKinematics
from .task_kinematics import JointKinematics as JointKinematics
from .task_kinematics import TaskKinematics as TaskKinematics
from .tracker_kinematics import Tracker as Tracker
from .tracker_kinematics import TrackerKinematics as TrackerKinematics
from .translations import Translation as Translation
from .typical_motion import TypicalMotion as TypicalMotion
