"""How estimates move: gradient, projected gradient, natural (log-det), boxed, or not at all."""

from .adaptation import Adaptation as Adaptation
from .box import Boxed as Boxed
from .cone import BodyCone as BodyCone
from .cone import Cone as Cone
from .frozen import Frozen as Frozen
from .gradient import Gradient as Gradient
from .natural import Natural as Natural
from .positive import Positive as Positive
from .projected import Projected as Projected
from .stacked import Stacked as Stacked
