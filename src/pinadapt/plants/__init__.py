"""Plants: the simulated robots that a controller drives, and their simulated sensors."""

from .elastic_plant import ElasticPlant as ElasticPlant
from .mujoco_plant import MujocoFile as MujocoFile
from .mujoco_plant import MujocoPlant as MujocoPlant
from .pinocchio_plant import PinocchioPlant as PinocchioPlant
from .plant import Plant as Plant
from .plant import SimulatedPlant as SimulatedPlant
from .sensors import SimulatedSensors as SimulatedSensors
