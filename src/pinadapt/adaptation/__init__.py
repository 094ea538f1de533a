"""Adaptations: how estimates follow errors, by gradient, natural, composite or least squares."""

from .adaptation import Adaptation as Adaptation
from .adaptation import Drive as Drive
from .adaptation import Drives as Drives
from .adaptation import Estimate as Estimate
from .adaptation import Frozen as Frozen
from .adaptation import Stacked as Stacked
from .adaptation import Wrapper as Wrapper
from .composite import Composite as Composite
from .composite import CompositeMemory as CompositeMemory
from .gradient import Gradient as Gradient
from .least_squares import LeastSquares as LeastSquares
from .modifications import DeadZone as DeadZone
from .modifications import ErrorLeak as ErrorLeak
from .modifications import Leak as Leak
from .modifications import Normalised as Normalised
from .natural import BodyInequality as BodyInequality
from .natural import ExponentiatedGradient as ExponentiatedGradient
from .natural import MatrixInequality as MatrixInequality
from .natural import Natural as Natural
from .projections import BoxProjection as BoxProjection
from .projections import GravityProjection as GravityProjection
from .projections import MassMatrixProjection as MassMatrixProjection
