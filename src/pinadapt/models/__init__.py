"""Models: the believed kinematics and dynamics of a robot, evaluated at an estimate."""

from .base_parameters import BaseParameters as BaseParameters
from .base_parameters import base_parameters as base_parameters
from .basis import BasisDynamics as BasisDynamics
from .bodies import BodyDynamics as BodyDynamics
from .dynamics import Dynamics as Dynamics
from .frame_kinematics import FrameKinematics as FrameKinematics
from .joint_effects import JointEffects as JointEffects
from .joint_kinematics import JointKinematics as JointKinematics
from .lumped import LumpedDynamics as LumpedDynamics
from .momentum import Momentum as Momentum
from .momentum import MomentumRegressor as MomentumRegressor
from .sight import Carrier as Carrier
from .sight import Sensed as Sensed
from .stacked import StackedDynamics as StackedDynamics
from .task_kinematics import TaskKinematics as TaskKinematics
from .translations import Translation as Translation
from .typical_motion import TypicalMotion as TypicalMotion
