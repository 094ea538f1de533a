"""Motions that identify unknown parameters as well as the limits of a robot allow."""

from .exciting_motion import ExcitingMotion as ExcitingMotion
from .exciting_motion import LimitUse as LimitUse
from .exciting_motion import excite as excite
