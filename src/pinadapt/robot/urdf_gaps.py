"""What URDFs leave out that the parser insists on, and that need not be known."""

from __future__ import annotations

import warnings
import xml.etree.ElementTree as ElementTree

_BOUNDED = ("revolute", "prismatic")
_NEEDED = ("effort", "velocity")


def fill_urdf_gaps(root: ElementTree.Element, where: str) -> None:
    """Add limits of zero, which mean none, and links that only carry others; warn of them.

    Written are ``effort`` and ``velocity`` of revolute and prismatic joints, their whole ``limit``,
    and links that joints name as parents but nothing defines, such as "world".
    """
    told = [*_fill_limits(root), *_fill_parents(root)]
    if told:
        warnings.warn(f"{where}: {'; '.join(told)}.", stacklevel=4)


def _fill_limits(root: ElementTree.Element) -> list[str]:
    open_joints = []
    for joint in root.findall("joint"):
        limit = joint.find("limit")
        if joint.get("type") not in _BOUNDED and limit is None:
            continue
        if limit is None:
            limit = ElementTree.SubElement(joint, "limit")
        missing = [name for name in _NEEDED if name not in limit.attrib]
        if missing:
            limit.attrib.update(dict.fromkeys(missing, "0"))
            open_joints.append(f"{joint.get('name', '')} ({', '.join(missing)})")
    return [f"no limit is stated for {', '.join(open_joints)}"] if open_joints else []


def _fill_parents(root: ElementTree.Element) -> list[str]:
    known = {link.get("name") for link in root.findall("link")}
    ends = (joint.find("parent") for joint in root.findall("joint"))
    named = {end.get("link", "") for end in ends if end is not None} - known - {""}
    for name in sorted(named):
        ElementTree.SubElement(root, "link", name=name)
    return [f"no link is called {', '.join(sorted(named))}: added, without a body"] if named else []
