"""What a run leaves behind: samples, arrays and a table."""

from .rollout import Rollout as Rollout
from .sample import Sample as Sample
from .transients import Transient as Transient
