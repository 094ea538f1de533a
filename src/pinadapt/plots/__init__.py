"""Pictures of a run."""

from .drawable import Drawable as Drawable
from .figures import Figures as Figures
from .figures import draw_all as draw_all
