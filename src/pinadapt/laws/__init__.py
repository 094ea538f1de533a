"""The control laws; a file has one and its relatives."""

from ..signals import Signals as Signals
from .acceleration_law import ComputedTorque as ComputedTorque
from .acceleration_law import ResolvedAcceleration as ResolvedAcceleration
from .adaptive_inverse_dynamics import AdaptiveInverseDynamics as AdaptiveInverseDynamics
from .adaptive_inverse_dynamics import (
    AdaptiveInverseDynamicsImproved as AdaptiveInverseDynamicsImproved,
)
from .adaptive_inverse_dynamics import (
    AdaptiveInverseDynamicsVelocity as AdaptiveInverseDynamicsVelocity,
)
from .adaptive_inverse_dynamics import Craig as Craig
from .adaptive_inverse_dynamics import SpongOrtega as SpongOrtega
from .adaptive_jacobian import AdaptiveJacobian as AdaptiveJacobian
from .approximate_jacobian import ApproximateJacobian as ApproximateJacobian
from .approximate_jacobian import ApproximateJacobianGravity as ApproximateJacobianGravity
from .approximate_jacobian import BoundedTorque as BoundedTorque
from .approximate_jacobian import Saturation as Saturation
from .fast_feedback import FastFeedback as FastFeedback
from .law import Command as Command
from .law import EstimatedModel as EstimatedModel
from .law import Feedback as Feedback
from .law import KinematicLoop as KinematicLoop
from .law import Law as Law
from .law import Truth as Truth
from .middleton_goodwin import MiddletonGoodwin as MiddletonGoodwin
from .posture import Posture as Posture
from .separation import Separation as Separation
from .slotine_li import SlotineLi as SlotineLi

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
