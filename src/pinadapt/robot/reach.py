"""How far a chain reaches."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from .chain import is_slide
from .position_limits import position_bounds


def reach(model: pin.Model, frame: int) -> float:
    """Return the length [m] of the stretched chain from first joint to frame, slides extended."""
    lower, upper = position_bounds(model)
    slides = [joint.idx_v for joint in model.joints[1:] if is_slide(joint)]
    lengths = [np.linalg.norm(placement.translation) for placement in model.jointPlacements[2:]]
    lengths.append(np.linalg.norm(model.frames[frame].placement.translation))
    return float(sum(lengths) + sum(upper[i] - lower[i] for i in slides))
