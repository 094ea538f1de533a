"""Scenario files: one TOML file defines a whole run."""

from .comparison import compare as compare
from .comparison import comparison_table as comparison_table
from .scenario import Scenario as Scenario
