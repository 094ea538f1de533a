"""Information in a motion: identifiable parameters, a load."""

from .information import Excitation as Excitation
from .information import Information as Information
from .information import TorquePrediction as TorquePrediction
from .information import along_excited as along_excited
from .payload import PayloadEstimate as PayloadEstimate
from .tracker import FoundTracker as FoundTracker
from .tracker import find_camera as find_camera
from .tracker import find_tracker as find_tracker
