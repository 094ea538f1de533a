"""Which parameters a motion can identify, and how well; the load in what was identified."""

from .information import Excitation as Excitation
from .information import Information as Information
from .motion_torques import TorquePrediction as TorquePrediction
from .motion_torques import along_excited as along_excited
from .payload import PayloadEstimate as PayloadEstimate
