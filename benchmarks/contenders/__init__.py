"""What a user would take instead of adaptation, as laws of one's own.

They know what the library's default starts from: the believed inertias, no friction, the described
tool. None moves an estimate.
"""

from .believed_robot import BelievedRobot as BelievedRobot
from .contender import CONTENDERS as CONTENDERS
from .contender import DEFAULT as DEFAULT
from .contender import Contender as Contender
from .contender import Gains as Gains
from .inverse_kinematics import InverseKinematics as InverseKinematics
from .joint_tracking import JointTracking as JointTracking
from .observed_torque import ObservedTorque as ObservedTorque
from .setting import SENSORS as SENSORS
from .setting import Setting as Setting
from .setting import setting as setting
