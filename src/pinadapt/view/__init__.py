"""Pictures that move: a rollout as a web page, a run watched live."""

from .animation import Animation as Animation
from .animation import animation_of as animation_of
from .live import LiveView as LiveView
