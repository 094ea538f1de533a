"""The record of a run, and what follows from it: verdict, summary, what was learned."""

from .recording import Ringing as Ringing
from .recording import Transient as Transient
from .recording import ringing as ringing
from .rollout import Rollout as Rollout
