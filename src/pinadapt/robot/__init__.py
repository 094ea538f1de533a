"""Robots: an open chain with a task and a home pose, its motors, and how it may change."""

from .base_from_legs import BaseFromLegs as BaseFromLegs
from .changes import Friction as Friction
from .changes import Payload as Payload
from .changes import Shaft as Shaft
from .constraints import Contact as Contact
from .constraints import Coupling as Coupling
from .constraints import Loop as Loop
from .loading import load as load
from .motors import Actuators as Actuators
from .motors import Gravity as Gravity
from .motors import torque_limits as torque_limits
from .robot import Robot as Robot
from .robot import Succession as Succession
from .workspace import reachable_circle as reachable_circle
from .workspace import reachable_circles as reachable_circles
