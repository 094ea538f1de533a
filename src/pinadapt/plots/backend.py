"""Import of matplotlib that tolerates an unknown MPLBACKEND: image files need no backend."""

from __future__ import annotations

import os
import sys

try:
    import matplotlib
except ValueError:  # MPLBACKEND names an unknown backend
    _named = os.environ.pop("MPLBACKEND", "")
    for _half in [name for name in sys.modules if name.partition(".")[0] == "matplotlib"]:
        del sys.modules[_half]
    import matplotlib

    os.environ["MPLBACKEND"] = _named

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

__all__ = ["Figure", "FigureCanvasAgg", "Line2D", "matplotlib"]
