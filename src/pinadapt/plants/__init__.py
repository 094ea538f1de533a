"""What is controlled: the true robot, and the sensors that see it."""

from .pinocchio_plant import PinocchioPlant as PinocchioPlant
from .plant import Plant as Plant
from .sensors import Sensors as Sensors
