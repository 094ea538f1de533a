"""The closed loop: a true plant, its sensors, sampled or continuous."""

from .plant import Plant as Plant
from .simulate import effort_limits as effort_limits
from .simulate import simulate as simulate
