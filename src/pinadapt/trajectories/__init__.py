"""Desired motions: coordinates with their first two derivatives at any time."""

from .circle import Circle as Circle
from .fourier_series import FourierSeries as FourierSeries
from .hold import Hold as Hold
from .lissajous import Lissajous as Lissajous
from .orientation import FixedOrientation as FixedOrientation
from .orientation import Orientation as Orientation
from .orientation import Swing as Swing
from .pose_circle import PoseCircle as PoseCircle
from .pose_trajectory import PoseTrajectory as PoseTrajectory
from .sinusoid import Sinusoid as Sinusoid
from .trajectory import Trajectory as Trajectory
from .waypoints import Waypoints as Waypoints
