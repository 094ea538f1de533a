"""Motions that a given robot can start, and follow: approaches, and time scaling to its limits."""

from .start import Approach as Approach
from .start import starting_from as starting_from
from .within_limits import JointMotion as JointMotion
from .within_limits import Slowing as Slowing
from .within_limits import WithinLimits as WithinLimits
from .within_limits import joint_motion as joint_motion
from .within_limits import within_limits as within_limits
