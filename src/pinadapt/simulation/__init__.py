"""The closed loop: a true plant, its sensors, sampled or continuous."""

from .plant import Plant as Plant
from .simulate import simulate as simulate
