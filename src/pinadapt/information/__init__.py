"""Which parameters a motion can tell apart, and how well; a payload from what was learned."""

from .information import Excitation as Excitation
from .information import Information as Information
from .payload import PayloadEstimate as PayloadEstimate
