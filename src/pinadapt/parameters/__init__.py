"""What is unknown about a robot: translations of its kinematics, parameters of its dynamics."""

from .basis import BasisParameters as BasisParameters
from .bodies import BodyParameters as BodyParameters
from .dynamic import DynamicParameters as DynamicParameters
from .kinematic import KinematicParameters as KinematicParameters
