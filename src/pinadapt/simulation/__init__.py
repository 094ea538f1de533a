"""The closed loop: a plant, its sensors and a controller, sampled or continuous."""

from .engine import Engine as Engine
from .loop import Events as Events
from .loop import run as run
from .loop import run_continuous as run_continuous
from .simulate import simulate as simulate
