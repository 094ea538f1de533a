"""Signals: the records between the parts, filters and desired trajectories."""

from .circle import Circle as Circle
from .hold import Hold as Hold
from .lissajous import Lissajous as Lissajous
from .low_pass import LowPass as LowPass
from .orientation import FixedOrientation as FixedOrientation
from .orientation import Orientation as Orientation
from .orientation import Swing as Swing
from .pose_trajectory import PoseTrajectory as PoseTrajectory
from .records import Desired as Desired
from .records import Measurement as Measurement
from .trajectory import Trajectory as Trajectory
from .waypoints import Waypoints as Waypoints
