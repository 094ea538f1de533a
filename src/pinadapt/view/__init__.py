"""Animations: a rollout as a web page, and a run shown while it goes on."""

from .animation import Animation as Animation
from .animation import animation_of as animation_of
from .live import LiveView as LiveView
