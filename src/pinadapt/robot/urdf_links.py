"""The inertias of a URDF's links, and how a body's new inertia is put into them."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from ..exceptions import RobotError

_HALVINGS = 30  # of what the other links keep, before there is nothing left to take
_SAME = 1e-9  # relative difference of inertias that is rounding
_ENTRIES = {
    **{"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2)},
    **{"iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)},
}


@dataclass(frozen=True, eq=False)
class Link:
    """A link of a body.

    Attributes:
        element: of the URDF.
        placement: of the link in the axes of the body's joint.
    """

    element: ElementTree.Element
    placement: pin.SE3

    def read(self) -> np.ndarray:
        """Return its ten parameters (10) about the body's joint, zeros where it has no inertia."""
        inertial = self.element.find("inertial")
        if inertial is None:
            return np.zeros(10)
        mass, inertia = inertial.find("mass"), inertial.find("inertia")
        at = placement_of_element(inertial)
        matrix = np.zeros((3, 3))
        for name, (i, j) in _ENTRIES.items():
            value = 0.0 if inertia is None else float(inertia.get(name, "0"))
            matrix[i, j] = matrix[j, i] = value
        kilograms = 0.0 if mass is None else float(mass.get("value", "0"))
        body = pin.Inertia(kilograms, np.zeros(3), matrix)
        return np.array((self.placement * at).act(body).toDynamicParameters())

    def write(self, ten: np.ndarray) -> None:
        """Give it ten parameters (10) about the body's joint."""
        body = self.placement.actInv(pin.Inertia.FromDynamicParameters(ten))
        inertial = self.element.find("inertial")
        if inertial is None:
            inertial = ElementTree.SubElement(self.element, "inertial")
        child(inertial, "origin").attrib.update(xyz=words(body.lever), rpy="0 0 0")
        child(inertial, "mass").set("value", words([body.mass]))
        inertia = child(inertial, "inertia")
        for name, (i, j) in _ENTRIES.items():
            inertia.set(name, words([body.inertia[i, j]]))


def distribute(ten: np.ndarray, main: Link, others: Sequence[Link], body: str) -> bool:
    """Give the links of one rigid body the ten parameters (10) of the whole; return if it changed.

    The main link takes what the others leave. Where that would not be physical, the others keep
    half of their inertia, or a quarter, and so on, until it is: the whole is, so it will.

    Raises:
        RobotError: the whole is not physical.
    """
    kept = [(link, link.read()) for link in others]
    rest = sum((part for _, part in kept), np.zeros(10))
    if np.allclose(main.read() + rest, ten, rtol=_SAME, atol=_SAME * np.abs(ten).max()):
        return False
    for halvings in range(_HALVINGS):
        share = 0.5**halvings
        if is_physical(ten - share * rest):
            main.write(ten - share * rest)
            for link, part in kept if halvings else ():
                if part.any():
                    link.write(share * part)
            return True
    raise RobotError(
        f"the body moved by joint '{body}' has an inertia that no distribution of mass has.",
        where="urdf",
        hint='Adaptation "natural" keeps bodies physical.',
    )


def is_physical(ten: np.ndarray) -> bool:
    """Tell whether ten parameters (10) are a body's: their pseudo-inertia is positive definite."""
    if ten[0] <= 0.0:
        return False
    P = pin.PseudoInertia.FromDynamicParameters(ten).toMatrix()
    scale = np.sqrt(np.maximum(np.diag(P), np.finfo(float).tiny))
    return bool(np.linalg.eigvalsh(P / np.outer(scale, scale))[0] > _SAME)


def placement_of_element(element: ElementTree.Element) -> pin.SE3:
    """Return the placement that the <origin> of an element states."""
    origin = element.find("origin")
    given = {} if origin is None else origin.attrib
    xyz, rpy = (np.array([float(w) for w in given.get(k, "0 0 0").split()]) for k in ("xyz", "rpy"))
    return pin.SE3(pin.rpy.rpyToMatrix(rpy), xyz)


def child(element: ElementTree.Element, tag: str) -> ElementTree.Element:
    """Return the child of an element with a tag, made where it is missing."""
    found = element.find(tag)
    return ElementTree.SubElement(element, tag) if found is None else found


def words(numbers: Sequence[float] | np.ndarray) -> str:
    """Return numbers as a URDF has them, to the last bit."""
    return " ".join(repr(float(number)) for number in numbers)
