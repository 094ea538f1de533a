"""Information in a motion: identifiable parameters, a load, whether torques fit a robot."""

from .information import Excitation as Excitation
from .information import Information as Information
from .information import TorquePrediction as TorquePrediction
from .information import along_excited as along_excited
from .payload import PayloadEstimate as PayloadEstimate
from .torque_check import TorqueCheck as TorqueCheck
from .torque_check import check_torques as check_torques
from .tracker import FoundTracker as FoundTracker
from .tracker import find_camera as find_camera
from .tracker import find_tracker as find_tracker
