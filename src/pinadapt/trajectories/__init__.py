"""Desired motions: coordinates with their first two derivatives at any time."""

from .crawl import Crawl as Crawl
from .given import Function as Function
from .given import Spline as Spline
from .given import TrajectoryLike as TrajectoryLike
from .given import as_trajectory as as_trajectory
from .periodic import Circle as Circle
from .periodic import FourierSeries as FourierSeries
from .periodic import Lissajous as Lissajous
from .periodic import Sinusoid as Sinusoid
from .pose import PoseCircle as PoseCircle
from .pose import PoseTrajectory as PoseTrajectory
from .pose import Swing as Swing
from .stacked import Stacked as Stacked
from .trajectory import Hold as Hold
from .trajectory import Retimed as Retimed
from .trajectory import SlowedTime as SlowedTime
from .trajectory import SmoothStart as SmoothStart
from .trajectory import TimeLaw as TimeLaw
from .trajectory import Trajectory as Trajectory
from .trajectory import Waypoints as Waypoints
