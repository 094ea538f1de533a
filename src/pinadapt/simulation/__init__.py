"""The closed loop: a plant, its sensors and a controller, sampled or continuous."""

from .simulate import simulate as simulate
