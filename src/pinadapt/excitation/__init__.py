"""Motions made to tell unknown parameters apart."""

from .excite import excite as excite
from .exciting_motion import ExcitingMotion as ExcitingMotion
from .limit_use import LimitUse as LimitUse
