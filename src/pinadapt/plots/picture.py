"""A figure that shows itself in Jupyter."""

from __future__ import annotations

import warnings
from io import BytesIO

from .backend import Figure, FigureCanvasAgg, matplotlib


class Picture(Figure):
    """A figure that pyplot does not know: it shows once, and goes with its last reference."""

    def png(self, dpi: int = 100) -> bytes:
        """Return the picture as a PNG file."""
        FigureCanvasAgg(self)
        buffer = BytesIO()
        with matplotlib.rc_context({"text.usetex": False}), warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="Glyph")  # a sign the font has not is a box
            self.savefig(buffer, format="png", dpi=dpi)
        return buffer.getvalue()

    def _repr_png_(self) -> bytes:
        """Return the picture as Jupyter shows it."""
        return self.png()
