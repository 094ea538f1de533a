"""Adaptive control of robots with uncertain kinematics and dynamics, on Pinocchio.

The names that most programs need stand in ``__init__.pyi``. The families of classes are one level
down, where they are looked for: ``pinadapt.laws``, ``adaptation``, ``trajectories``, ``plants``,
``models`` and others. Each name is imported at its first use, so that a command that prints a list
loads no control law.
"""

from importlib import import_module
from pkgutil import iter_modules
from sys import modules

import lazy_loader

_first_use, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> object:
    """Return a public name at its first use.

    Raises:
        AttributeError: there is no such name; the message says where it is, if it is further down.
    """
    if name in __all__:
        return _first_use(name)
    place = "" if name.startswith("_") else _place(name)
    raise AttributeError(
        f"module {__name__!r} has no attribute {name!r}{place and f': it is {place}'}",
        name=name,
        obj=modules[__name__],
    )


def _place(name: str) -> str:
    """Return the full name of what has a name further down in this package, or an empty text."""
    below = [module for module in iter_modules(__path__) if not module.name.startswith("_")]
    # packages first: a single file has as attributes what it imports from them
    for room in sorted(below, key=lambda each: (not each.ispkg, each.name not in __all__)):
        found = getattr(import_module(f"{__name__}.{room.name}"), name, None)
        ours = str(getattr(found, "__module__", "")).startswith(f"{__name__}.")
        if ours or (found is not None and name.isupper()):
            return f"{__name__}.{room.name}.{name}"
    return ""
