"""The record of a run, and what follows from it: verdict, summary, what was learned."""

from .recording import Transient as Transient
from .rollout import Rollout as Rollout
