"""Filters: memory that signals drive."""

from .low_pass import LowPass as LowPass
