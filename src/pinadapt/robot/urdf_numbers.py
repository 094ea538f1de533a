"""The numbers of a URDF, checked before its parser drops those that it cannot read."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator

from ..exceptions import RobotError

# element -> attribute -> how many numbers it holds
_NUMBERS: dict[str, dict[str, int]] = {
    "origin": {"xyz": 3, "rpy": 3},
    "axis": {"xyz": 3},
    "mass": {"value": 1},
    "inertia": {"ixx": 1, "ixy": 1, "ixz": 1, "iyy": 1, "iyz": 1, "izz": 1},
    "limit": {"lower": 1, "upper": 1, "effort": 1, "velocity": 1},
    "dynamics": {"damping": 1, "friction": 1, "armature": 1},
    "mimic": {"multiplier": 1, "offset": 1},
    "box": {"size": 3},
    "sphere": {"radius": 1},
    "cylinder": {"radius": 1, "length": 1},
    "capsule": {"radius": 1, "length": 1},
    "mesh": {"scale": 3},
}
_REQUIRED = {"mass", "inertia"}


def check_urdf_numbers(root: ElementTree.Element, where: str) -> None:
    """Refuse numbers of links and joints that cannot be read, are not finite, or are missing.

    Raises:
        RobotError: the first of them; the link or joint, the element and its text are named.
    """
    for part in root:
        if part.tag in ("link", "joint"):
            owner = f"{part.tag} '{part.get('name', '')}'"
            for element in part.iter():
                for flaw in _flaws(element):
                    raise RobotError(f"{owner}, <{element.tag}>: {flaw}.", where=where, hint=_HINT)


_HINT = "Numbers are written with a point, lists with spaces between their numbers."


def _flaws(element: ElementTree.Element) -> Iterator[str]:
    for name, count in _NUMBERS.get(element.tag, {}).items():
        text = element.get(name)
        if text is not None:
            flaw = flaw_of_numbers(text, count)
            if flaw:
                yield f'{name}="{text}" {flaw}'
        elif element.tag in _REQUIRED:
            yield f"{name} is missing"


def flaw_of_numbers(text: str, count: int | None = None) -> str | None:
    """Return what is wrong with a text of ``count`` numbers, or of any, or None."""
    numbers = [_number(word) for word in text.split()]
    readable = [number for number in numbers if number is not None]
    if len(readable) < len(numbers) or len(numbers) != (count or len(numbers)) or not numbers:
        return f"is not {'a number' if count == 1 else f'{count} numbers' if count else 'numbers'}"
    if any(math.isnan(number) for number in readable):
        return "is not a number"
    return "is not finite" if any(map(math.isinf, readable)) else None


def _number(word: str) -> float | None:
    """Return a number as a C program reads it, or None."""
    try:
        return None if "_" in word or not word.isascii() else float(word)
    except ValueError:
        return None
