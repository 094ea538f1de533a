"""How far a chain reaches."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from .chain import is_slide
from .position_limits import position_limits

_TRAVEL = 2.0  # [m] of a slide without limits in a chain of nothing else


def reach(model: pin.Model, frame: int) -> float:
    """Return the length [m] of the stretched chain from first joint to frame, slides extended.

    A slide without limits, such as a mobile base, adds nothing, unless there is nothing else.
    """
    lower, upper = position_limits(model)
    slides = [joint.idx_v for joint in model.joints[1:] if is_slide(joint)]
    travel = (upper - lower)[np.array(slides, dtype=int)]
    lengths = [np.linalg.norm(placement.translation) for placement in model.jointPlacements[2:]]
    lengths.append(np.linalg.norm(model.frames[frame].placement.translation))
    length = float(sum(lengths) + travel[np.isfinite(travel)].sum())
    return length or _TRAVEL * len(travel)
