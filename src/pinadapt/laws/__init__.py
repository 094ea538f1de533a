"""The control laws, one a file."""

from .adaptive_inverse_dynamics import AdaptiveInverseDynamics as AdaptiveInverseDynamics
from .adaptive_inverse_dynamics_improved import (
    AdaptiveInverseDynamicsImproved as AdaptiveInverseDynamicsImproved,
)
from .adaptive_inverse_dynamics_velocity import (
    AdaptiveInverseDynamicsVelocity as AdaptiveInverseDynamicsVelocity,
)
from .adaptive_jacobian import AdaptiveJacobian as AdaptiveJacobian
from .gains import Gains as Gains
from .law import Command as Command
from .law import Gradients as Gradients
from .law import Law as Law
from .law import Signals as Signals
from .law import Truth as Truth
from .posture import Posture as Posture
from .resolved_acceleration import ResolvedAcceleration as ResolvedAcceleration

LAWS: dict[str, type[Law]] = {
    law.name: law
    for law in (
        ResolvedAcceleration,
        AdaptiveInverseDynamics,
        AdaptiveInverseDynamicsVelocity,
        AdaptiveInverseDynamicsImproved,
        AdaptiveJacobian,
    )
}
