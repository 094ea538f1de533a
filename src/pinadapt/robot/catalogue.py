"""The robots that come along: our own folder ``robots/`` and example-robot-data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import pinocchio as pin

from .._toml import read_toml
from ..exceptions import RobotError, did_you_mean
from .urdf import read_urdf


@dataclass(frozen=True)
class CatalogueEntry:
    """One robot of the catalogue.

    Attributes:
        name: name in the catalogue.
        frame: default task frame.
        task: default task.
        origin: "pinadapt", or the name of the loader in example-robot-data.
        path: URDF file for our own robots, None for example-robot-data's.
        q0: home pose, one angle a joint [rad or m], or None for a searched one.
        about: a line for people.
    """

    name: str
    frame: str
    task: str
    origin: str
    path: Path | None
    q0: tuple[float, ...] | None
    about: str

    def load(self) -> tuple[pin.Model, pin.GeometryModel | None, Any]:
        """Return the whole model, its visual geometry, and a reference configuration (nq) or None."""
        if self.path is not None:
            return (*read_urdf(self.path), None)
        import example_robot_data  # slow to import, and not needed for a user's own URDF

        wrapper = example_robot_data.load(self.origin)
        return wrapper.model, wrapper.visual_model, wrapper.q0


def robots_folder() -> Path:
    """Return the folder of our own robots: inside an installed package, or beside ``src`` in a checkout."""
    package = Path(__file__).resolve().parents[1]
    for folder in (package / "robots", package.parents[1] / "robots"):
        if (folder / "catalogue.toml").is_file():
            return folder
    raise RobotError("the folder 'robots' with catalogue.toml is missing from this installation.", where=str(package))


@cache
def catalogue() -> Mapping[str, CatalogueEntry]:
    """Return all robots of the catalogue by name."""
    folder = robots_folder()
    entries = {}
    for name, row in read_toml(folder / "catalogue.toml").items():
        entries[name] = CatalogueEntry(
            name=name,
            frame=row["frame"],
            task=row.get("task", "xyz"),
            origin="pinadapt" if "urdf" in row else row.get("loader", name),
            path=folder / row["urdf"] if "urdf" in row else None,
            q0=tuple(row["q0"]) if "q0" in row else None,
            about=row.get("about", ""),
        )
    return entries


def catalogue_entry(name: str) -> CatalogueEntry:
    """Return one robot of the catalogue.

    Raises:
        RobotError: unknown name; the nearest is suggested.
    """
    if name not in catalogue():
        raise RobotError(
            f"'{name}' is neither a robot of the catalogue nor a URDF file.{did_you_mean(name, catalogue())}",
            where="source",
            hint="See `pinadapt robots`.",
        )
    return catalogue()[name]
