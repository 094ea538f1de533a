"""A figure that shows itself in Jupyter."""

from __future__ import annotations

from io import BytesIO

from .backend import Figure, FigureCanvasAgg


class Picture(Figure):
    """A figure that pyplot does not know: it shows once, and goes with its last reference."""

    def _repr_png_(self) -> bytes:
        """Return the picture as Jupyter shows it."""
        FigureCanvasAgg(self)
        buffer = BytesIO()
        self.savefig(buffer, format="png", dpi=100)
        return buffer.getvalue()
