"""The meshes of a URDF: found, tried, and left out one by one where they cannot be read."""

from __future__ import annotations

import warnings
import xml.etree.ElementTree as ElementTree

import coal
import numpy as np

from .packages import WHERE_PACKAGES_ARE, Packages

_SHOWN = 3  # missing meshes in a warning


def keep_readable_meshes(
    root: ElementTree.Element, packages: Packages, loader: coal.MeshLoader, where: str
) -> None:
    """Write into a URDF the path of each mesh, and take out the shapes whose mesh is unreadable.

    Meshes are read by ``loader``, which keeps them. One warning tells which are missing.
    """
    missing: dict[str, str] = {}
    for link in root.iter("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            mesh = shape.find("geometry/mesh")
            if mesh is None:
                continue
            name = mesh.get("filename", "")
            flaw = missing.get(name) or _flaw(mesh, packages, loader)
            if flaw:
                missing[name] = flaw
                link.remove(shape)
    if missing:
        told = "; ".join(f"{name}: {flaw}" for name, flaw in list(missing.items())[:_SHOWN])
        more = f"; and {len(missing) - _SHOWN} more" if len(missing) > _SHOWN else ""
        warnings.warn(
            f"{where}: not drawn, for their meshes cannot be read: {told}{more}. "
            f"{WHERE_PACKAGES_ARE}",
            stacklevel=2,
        )


def _flaw(mesh: ElementTree.Element, packages: Packages, loader: coal.MeshLoader) -> str | None:
    """Write the path of a mesh into its element, or return why it cannot be read."""
    file = packages.file(mesh.get("filename", ""))
    if file is None:
        return "no such file"
    mesh.set("filename", str(file))
    try:
        scale = np.array([float(word) for word in mesh.get("scale", "1 1 1").split()])
        loader.load(str(file), scale)
    except Exception as error:  # of any kind: they come from a parser of many formats
        return str(error).strip().splitlines()[-1]
    return None
