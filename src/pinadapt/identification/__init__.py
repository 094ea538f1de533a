"""Identification of robots from recorded motions, without control."""

from .identification import Identification as Identification
from .identification import identify as identify
