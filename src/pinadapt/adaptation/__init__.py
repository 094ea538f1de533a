"""How estimates move: by gradient, natural, composite, least squares, or not at all."""

from .adaptation import Adaptation as Adaptation
from .adaptation import Wrapper as Wrapper
from .box_projection import BoxProjection as BoxProjection
from .composite import Composite as Composite
from .composite_memory import CompositeMemory as CompositeMemory
from .dead_zone import DeadZone as DeadZone
from .drive import Drive as Drive
from .drive import Drives as Drives
from .drive import Estimate as Estimate
from .error_leak import ErrorLeak as ErrorLeak
from .exponentiated_gradient import ExponentiatedGradient as ExponentiatedGradient
from .frozen import Frozen as Frozen
from .gradient import Gradient as Gradient
from .gravity_projection import GravityProjection as GravityProjection
from .leak import Leak as Leak
from .least_squares import LeastSquares as LeastSquares
from .mass_matrix_projection import MassMatrixProjection as MassMatrixProjection
from .matrix_inequality import BodyInequality as BodyInequality
from .matrix_inequality import MatrixInequality as MatrixInequality
from .natural import Natural as Natural
from .normalised import Normalised as Normalised
from .stacked import Stacked as Stacked
