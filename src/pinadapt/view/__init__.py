"""Animations: a rollout as a web page, and a run shown while it goes on."""

from .live import LiveView as LiveView
from .page import Animation as Animation
from .page import animation_of as animation_of
