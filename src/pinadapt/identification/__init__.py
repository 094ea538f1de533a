"""Robots learned from recorded motions, without control."""

from .identification import Identification as Identification
from .identify import identify as identify
