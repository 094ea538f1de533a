"""Identification of robots from recorded motions, without control."""

from .calibration import Calibration as Calibration
from .calibration import FrameErrors as FrameErrors
from .calibration import calibrate as calibrate
from .estimator import Estimate as Estimate
from .estimator import Estimator as Estimator
from .identification import identify as identify
from .report import Identification as Identification
from .torque_check import TorqueCheck as TorqueCheck
from .torque_check import check_torques as check_torques
