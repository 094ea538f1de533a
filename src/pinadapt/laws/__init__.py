"""The control laws, one a file."""

from .adaptive_inverse_dynamics import AdaptiveInverseDynamics as AdaptiveInverseDynamics
from .adaptive_inverse_dynamics_improved import (
    AdaptiveInverseDynamicsImproved as AdaptiveInverseDynamicsImproved,
)
from .adaptive_inverse_dynamics_velocity import (
    AdaptiveInverseDynamicsVelocity as AdaptiveInverseDynamicsVelocity,
)
from .adaptive_jacobian import AdaptiveJacobian as AdaptiveJacobian
from .approximate_jacobian import ApproximateJacobian as ApproximateJacobian
from .approximate_jacobian_gravity import (
    ApproximateJacobianGravity as ApproximateJacobianGravity,
)
from .bounded_torque import BoundedTorque as BoundedTorque
from .computed_torque import ComputedTorque as ComputedTorque
from .craig import Craig as Craig
from .feedback import Feedback as Feedback
from .feedback import KinematicLoop as KinematicLoop
from .law import Believed as Believed
from .law import Command as Command
from .law import Law as Law
from .law import Truth as Truth
from .middleton_goodwin import MiddletonGoodwin as MiddletonGoodwin
from .posture import Posture as Posture
from .resolved_acceleration import ResolvedAcceleration as ResolvedAcceleration
from .saturation import Saturation as Saturation
from .separation import Separation as Separation
from .slotine_li import SlotineLi as SlotineLi
from .spong_ortega import SpongOrtega as SpongOrtega

LAWS: dict[str, type[Law]] = {
    law.name: law
    for law in (
        Separation,
        ResolvedAcceleration,
        AdaptiveInverseDynamics,
        AdaptiveInverseDynamicsVelocity,
        AdaptiveInverseDynamicsImproved,
        AdaptiveJacobian,
        ComputedTorque,
        SlotineLi,
        Craig,
        SpongOrtega,
        MiddletonGoodwin,
        ApproximateJacobian,
        ApproximateJacobianGravity,
        BoundedTorque,
    )
}

DEFAULT = Separation.name
