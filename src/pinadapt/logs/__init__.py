"""Recorded motions: every file format is read into one kind of log."""

from .formats import FORMATS as FORMATS
from .formats import read_log as read_log
from .import_options import ImportOptions as ImportOptions
from .log import Log as Log
