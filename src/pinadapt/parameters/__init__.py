"""What is unknown about a robot: translations of its kinematics, parameters of its dynamics."""

from .basis import BasisParameters as BasisParameters
from .bodies import BodyParameters as BodyParameters
from .dynamic import DynamicParameters as DynamicParameters
from .joint import JointParameters as JointParameters
from .kinematic import KinematicParameters as KinematicParameters
from .lumped import LumpedParameters as LumpedParameters
from .stacked import StackedParameters as StackedParameters
