"""Adaptive control of robots with uncertain kinematics and dynamics, on Pinocchio.

The public names stand in ``__init__.pyi``. Each is imported when it is first used: a command that
prints a list waits for no control law.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
