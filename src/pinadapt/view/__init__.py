"""Pictures that move: a rollout as a web page."""

from .animation import write_animation as write_animation
