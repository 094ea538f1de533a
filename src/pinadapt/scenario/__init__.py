"""Scenario files: one TOML file says everything about a run."""

from .scenario import Scenario as Scenario
