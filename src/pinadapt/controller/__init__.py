"""The controller: law, models and adaptation in one object with explicit state."""

from ..records import SensorQuality as SensorQuality
from .announcement import NominalRobot as NominalRobot
from .controller import Controller as Controller
from .governor import Governor as Governor
from .governor import PathTime as PathTime
from .learned import LearnedParameters as LearnedParameters
from .limits import ControllerLimits as ControllerLimits
from .limits import Limits as Limits
from .residuals import Guards as Guards
from .sensing import Senses as Senses
from .slow_start import SlowStart as SlowStart
from .state import ControllerState as ControllerState
from .state import Sample as Sample
