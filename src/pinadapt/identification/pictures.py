"""The two pictures of an identification."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, NamedTuple

from .._files import whole_file
from ..plots.backend import matplotlib
from ..plots.parameter_figure import parameter_figure
from ..plots.picture import Picture
from ..plots.prediction_figure import prediction_figure
from ..plots.style import RC

if TYPE_CHECKING:
    from .identification import Identification


class Pictures(NamedTuple):
    """What an identification shows; in Jupyter each picture shows itself.

    Attributes:
        torque: of each joint as measured, and as predicted by the description and by what was
            learned before the part that is held out.
        parameters: the online estimates in time, those of the whole log dashed.
    """

    torque: Picture
    parameters: Picture


def pictures_of(found: Identification) -> Pictures:
    """Draw what was identified."""
    windows, title = found.windows, f"{found.described.name}, {Path(found.log.source).name}"
    before, after = (windows.residual(a) for a in (found.described_parameters, found.before_split))
    online = SimpleNamespace(
        title=title,
        law="identified online",
        adaptation=found.estimator.controller.adaptation_d.name,
        t=found.online.t,
        a_k=found.online.a_k,
        a_d=found.online.a_d,
        a_k_true=found.kinematic.estimate,
        a_d_true=found.dynamic.estimate,
        kinematic_names=found.kinematic.names,
        dynamic_names=found.dynamic.names,
        marks=(),
        diverged=None,
        interrupted=None,
    )
    with matplotlib.rc_context(RC):
        torque = prediction_figure(
            title,
            found.described.joint_names,
            windows.t,
            windows.tau,
            {"described": windows.tau - before, "learned until then": windows.tau - after},
            found.split,
        )
        return Pictures(torque, parameter_figure(online, "dashed: whole log"))


def draw(found: Identification, folder: Path) -> list[Path]:
    """Write ``torque.png`` and ``parameters.png``, each whole; return their paths."""
    paths = []
    for name, picture in pictures_of(found)._asdict().items():
        paths.append(folder / f"{name}.png")
        with whole_file(paths[-1]) as file:
            file.write(picture.png(dpi=130))
    return paths
