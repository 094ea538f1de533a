"""Pictures of a run."""

from .figures import draw_all as draw_all
