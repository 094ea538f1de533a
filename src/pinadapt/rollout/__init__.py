"""What a run leaves behind: samples, arrays and a table."""

from .excitation import Excitation as Excitation
from .information import Information as Information
from .payload_estimate import PayloadEstimate as PayloadEstimate
from .rollout import Rollout as Rollout
from .sample import Sample as Sample
from .transients import Transient as Transient
