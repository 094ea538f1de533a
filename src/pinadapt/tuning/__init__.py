"""From a user's few words to a controller: defaults, rates, and the check before a run."""

from .make_controller import make_controller as make_controller
from .preflight import Finding as Finding
from .preflight import preflight as preflight
from .rates import ADAPTATIONS as ADAPTATIONS
from .unknowns import Unknown as Unknown
