"""Motions made to tell unknown parameters apart."""

from .exciting_motion import ExcitingMotion as ExcitingMotion
from .exciting_motion import LimitUse as LimitUse
from .search import excite as excite
