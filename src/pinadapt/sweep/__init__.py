"""Sweeps: a scenario, or a function, with many values, on all cores or a cluster, as one table."""

from .cases import Case as Case
from .cases import Cases as Cases
from .cases import Plan as Plan
from .execution import EngineError as EngineError
from .execution import Here as Here
from .execution import Processes as Processes
from .execution import numbers_of as numbers_of
from .execution import run_case as run_case
from .execution import sweep as sweep
from .sweep_report import Report as Report
from .table import CaseTable as CaseTable
from .table import read as read
