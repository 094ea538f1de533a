"""Alternatives to adaptation, written as control laws.

They have the model from which the library's default starts: its inertias, no friction, the
described tool. None adapts anything.
"""

from .contender import CONTENDERS as CONTENDERS
from .contender import DEFAULT as DEFAULT
from .contender import Contender as Contender
from .contender import Gains as Gains
from .inverse_kinematics import InverseKinematics as InverseKinematics
from .joint_tracking import JointTracking as JointTracking
from .nominal_robot import NominalRobot as NominalRobot
from .observed_torque import ObservedTorque as ObservedTorque
from .setting import SENSORS as SENSORS
from .setting import Setting as Setting
from .setting import setting as setting
