"""The controller: law, belief and adaptation in one object with explicit state."""

from .controller import Controller as Controller
from .make import ADAPTATIONS as ADAPTATIONS
from .make import make_controller as make_controller
from .preflight import Finding as Finding
from .preflight import preflight as preflight
from .state import ControllerState as ControllerState
