"""The three pictures of a run: error, parameters, torque."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from .._files import whole_file
from .backend import matplotlib
from .drawable import Drawable
from .error_figure import error_figure
from .parameter_figure import parameter_figure
from .picture import Picture
from .style import RC
from .torque_figure import torque_figure


class Figures(NamedTuple):
    """The pictures of a run; they show themselves in Jupyter, each once.

    Attributes:
        error: the task error, each coordinate and its norm, and V(t) where it is known.
        parameters: the estimates, and their truth.
        torque: the motor torques, and the smallest eigenvalue of the estimated mass matrix.
    """

    error: Picture
    parameters: Picture
    torque: Picture

    @classmethod
    def of(cls, run: Drawable) -> Figures:
        """Draw a run."""
        with matplotlib.rc_context(RC):
            return cls(error_figure(run), parameter_figure(run), torque_figure(run))

    def save(self, folder: Path) -> list[Path]:
        """Write ``error.png``, ``parameters.png``, ``torque.png`` into a folder; return paths.

        Each is whole or not there.
        """
        paths = []
        for name, figure in self._asdict().items():
            paths.append(folder / f"{name}.png")
            with whole_file(paths[-1]) as file:
                file.write(figure.png(dpi=130))
        return paths

    def _ipython_display_(self) -> None:
        """Show one picture below the other."""
        from IPython.display import display  # which runs the notebook that calls this

        for figure in self:
            display({"image/png": figure.png()}, raw=True)


def draw_all(run: Drawable, folder: Path) -> list[Path]:
    """Draw the pictures of a run into a folder; return their paths."""
    return Figures.of(run).save(folder)
