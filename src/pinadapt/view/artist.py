"""Meshes of a description, drawn with no file on the page that is not the robot's."""

from __future__ import annotations

import warnings
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import pinocchio as pin
from pinocchio.visualize import MeshcatVisualizer
from pinocchio.visualize.meshcat_visualizer import DaeMeshGeometry

_MESHES = "meshes"


class Artist(MeshcatVisualizer):
    """Pinocchio's, without its trust in every file that a Collada mesh names as an image."""

    def loadMeshFromFile(self, shape: pin.GeometryObject) -> Any:  # Pinocchio's name
        """Return a mesh, without the images that are missing or not the robot's."""
        path = Path(shape.meshPath)
        strange = strange_images(path) if path.suffix.lower() == ".dae" else []
        if not strange:
            return super().loadMeshFromFile(shape)
        warnings.warn(
            f"{path}: the images {strange} are missing or outside of the robot's folder, "
            f"{robot_folder(path)}. The mesh is drawn without them.",
            stacklevel=2,
        )
        mesh = DaeMeshGeometry(str(path), {Path(name) for name in strange})  # which are not read
        for name in strange:
            mesh.dae_raw = mesh.dae_raw.replace(f">{name}<", "><")
        return mesh


def robot_folder(mesh: Path) -> Path:
    """Return the folder of a mesh's robot, links followed.

    That is its ROS package; else the folder that holds the nearest folder called "meshes" above it;
    else its own folder.
    """
    folders = mesh.resolve().parents
    for folder in folders:
        if (folder / "package.xml").is_file():
            return folder
    return next((folder.parent for folder in folders if folder.name == _MESHES), folders[0])


def strange_images(mesh: Path) -> list[str]:
    """Return the images of a Collada mesh that are no files inside of its robot's folder.

    Links are followed; a URL is no file.
    """
    here, folder = mesh.parent, robot_folder(mesh)
    strange = set()
    for library in ElementTree.parse(mesh).iter():
        if library.tag.rpartition("}")[2] != "library_images":
            continue
        for element in library.iter():
            name = (element.text or "") if "init_from" in element.tag else ""
            image = (here / name).resolve()
            if name and not (image.is_file() and image.is_relative_to(folder)):
                strange.add(name)
    return sorted(strange)
