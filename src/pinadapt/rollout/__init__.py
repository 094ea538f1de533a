"""What a run leaves behind: arrays, a table, plots."""

from .rollout import Rollout as Rollout
