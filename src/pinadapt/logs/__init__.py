"""Recorded motions: every file format is read into one kind of log."""

from .log import Log as Log
from .read import FORMATS as FORMATS
from .read import read_log as read_log
