"""Adaptive control of robots with uncertain kinematics and dynamics, on Pinocchio.

The public names stand in ``__init__.pyi``. Each is imported when it is first used: a command that
prints a list waits for no control law.
"""

from sys import modules

import lazy_loader

_first_use, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> object:
    """Return a public thing at its first use; of other names Python says what they are like."""
    if name in __all__:
        return _first_use(name)
    raise AttributeError(
        f"module {__name__!r} has no attribute {name!r}", name=name, obj=modules[__name__]
    )
