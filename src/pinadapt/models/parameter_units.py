"""Units of dynamic parameters, by their names."""

from __future__ import annotations

from collections.abc import Mapping

from .regressor import LABELS

_INERTIAL = ("kg", *("kg m",) * 3, *("kg m^2",) * 6)
# Kind of a joint's coefficient -> unit where it turns, and where it slides.
_JOINT = {
    "armature": ("kg m^2", "kg"),
    "viscous": ("N m s/rad", "N s/m"),
    "coulomb": ("N m", "N"),
}


def unit_of(name: str, slides: Mapping[str, bool]) -> str:
    """Return the unit of a parameter "joint.label"; empty for one of a user's or a lumped basis.

    Args:
        name: of the parameter.
        slides: joint name -> whether it is prismatic.
    """
    joint, _, label = name.rpartition(".")
    if label in _JOINT:
        return _JOINT[label][slides.get(joint, False)]
    return dict(zip(LABELS, _INERTIAL, strict=True)).get(label, "")
