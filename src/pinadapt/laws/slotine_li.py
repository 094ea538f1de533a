"""The adaptive law of Slotine and Li in joint space."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from ..exceptions import GainError
from ..models.typical_motion import TypicalMotion, joint_inertia
from ..signals import Signals
from .adaptive_jacobian import AdaptiveJacobian
from .law import Truth, check_in_place


@dataclass(frozen=True, eq=False)
class SlotineLi(AdaptiveJacobian):
    """Adaptive manipulator control: J.-J. Slotine, W. Li, IJRR 6(3) (1987) 49-59.

    The adaptive Jacobian law on a joint task, x = q and J = I, with K_v = K_D, alpha = Lambda and
    K_P = alpha K_v.

    Law:          tau = Y(q, qd, qd_r, qdd_r) a_d - K_D s, qd_r = qd_d - Lambda e_q, s = qd - qd_r,
                  e_q = q - q_d on the manifold.
    Adaptation:   da_d/dt = -Gamma_d Y^T s.
    Closed loop:  M ds/dt + C s = -K_D s + Y da_d.
    V:            s^T M s / 2 + D_d(a_d), dV/dt = -s^T K_D s - s^T (f(qd) - f(qd_r)), f the true
                  friction of the joints: monotone, so the last term is at most zero.
    Assumptions:  constant parameters; kinematics known. Neither acceleration nor M_hat^-1 is
                  needed.

    Default gains for the bandwidth w: Lambda = w / 2 and K_D = 2 w diag(M) at home, so that the
    linear part is critically damped at w.

    Attributes:
        K_v: (n, n) K_D [N m s/rad or N s/m].
        K_P: (n, n) alpha K_v; not to be given.
        alpha: Lambda [1/s].
    """

    posture: Any = None
    K_P: Any = None

    name = "slotine-li"
    sources = ("SlotineLi1987",)
    joint_space = True
    bandwidth_powers: ClassVar[dict[str, float]] = {"Kv": 1.0, "alpha": 1.0}
    units = ("N m s/rad", "")

    def __post_init__(self) -> None:
        """Complete the gains.

        Raises:
            GainError: gains that break a hypothesis of the proof.
        """
        check_in_place(self, "K_v", "alpha", "R_k", "lambda_")
        object.__setattr__(self, "K_P", self.alpha * self.K_v)

    @classmethod
    def default_gains(cls, motion: TypicalMotion, dt: float, w: float) -> dict[str, Any]:
        """Return the default gains, as the class states them."""
        return {"Kv": 2.0 * w * joint_inertia(motion.robot), "alpha": w / 2.0}

    @classmethod
    def tuned(cls, motion: TypicalMotion, dt: float, share: float = 1.0, **given: Any) -> SlotineLi:
        """Return the law with its default gains; see ``Law.tuned``.

        Raises:
            GainError: K_P is given.
        """
        if given.get("Kp") is not None:
            raise GainError("the law 'slotine-li' has none: K_P is alpha Kv.", where="Kp")
        return super().tuned(motion, dt, share, **given)

    def storage(self, s: Signals, truth: Truth) -> float:
        """Return s^T M s / 2, M the true mass matrix."""
        error = self._error(s)
        return 0.5 * error @ (truth.M @ error)

    def dissipation(self, s: Signals, truth: Truth) -> float:
        """Return dV/dt."""
        error = self._error(s)
        return -error @ (self.K_v @ error) - self._joint_dissipation(s, truth)
