"""Filters: memory that measurements drive."""

from .filtered_regressor import FilteredRegressor as FilteredRegressor
from .filtered_regressor import FilteredTorque as FilteredTorque
from .filtered_regressor import TorqueFilterState as TorqueFilterState
from .filters import Filters as Filters
from .filters import NoFilters as NoFilters
from .low_pass import LowPass as LowPass
from .motion_filters import FilteredMotion as FilteredMotion
from .motion_filters import MotionFilters as MotionFilters
from .motion_filters import MotionState as MotionState
from .position_observer import PositionObserver as PositionObserver
