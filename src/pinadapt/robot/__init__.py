"""Robots: any description, name or Pinocchio model becomes one chain with a task frame."""

from .catalogue import CatalogueEntry as CatalogueEntry
from .catalogue import catalogue as catalogue
from .catalogue import robots_folder as robots_folder
from .changes import Payload as Payload
from .effort_limits import effort_limits as effort_limits
from .effort_limits import torque_limits as torque_limits
from .friction import Friction as Friction
from .gravity import Gravity as Gravity
from .loading import load as load
from .robot import Robot as Robot
from .succession import Succession as Succession
from .workspace import reachable_circle as reachable_circle
