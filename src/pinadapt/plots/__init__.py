"""Figures of a run."""

from .figures import Figures as Figures
from .figures import draw_all as draw_all
from .style import Drawable as Drawable
