"""Which parameters a motion can identify, and how well; the load in what was identified."""

from .information import Excitation as Excitation
from .information import Information as Information
from .payload import PayloadEstimate as PayloadEstimate
