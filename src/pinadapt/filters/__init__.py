"""Filters: memory driven by measurements."""

from .filters import FilteredMotion as FilteredMotion
from .filters import Filters as Filters
from .filters import LowPass as LowPass
from .filters import MotionFilters as MotionFilters
from .filters import NoFilters as NoFilters
from .filters import PositionObserver as PositionObserver
from .torque_filter import FilteredRegressor as FilteredRegressor
from .torque_filter import FilteredTorque as FilteredTorque
from .torque_filter import TorqueFilterState as TorqueFilterState
