"""The closed loop: a plant, its sensors and a controller, sampled or continuous."""

from .continuous import run_continuous as run_continuous
from .events import Events as Events
from .run import run as run
from .simulate import simulate as simulate
