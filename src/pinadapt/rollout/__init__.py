"""What a run leaves behind: arrays and a table."""

from .rollout import Rollout as Rollout
