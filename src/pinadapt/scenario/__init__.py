"""Scenario files: one TOML file defines a whole run."""

from .scenario import Scenario as Scenario
