"""What a run leaves behind: samples, arrays and a table."""

from .rollout import Rollout as Rollout
from .summary import Transient as Transient
