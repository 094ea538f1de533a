"""Everything the controller remembers from one sample to the next."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class ControllerState(NamedTuple):
    """An immutable snapshot; keep an old one and you can go back to it.

    Attributes:
        a_d: (p_d) dynamic estimate.
        a_k: (p_k) kinematic estimate [m].
        a_0: (p_d) the dynamic estimate at the start.
        W_k: (m_p, p_k) filtered kinematic regressor of the m_p positions, (3).
        xi: (m_p) low-passed lambda x + y_p0, from which y = lambda x - xi comes, (4) [m/s].
        z: (n) low-passed joint velocity, from which the joint acceleration comes.
    """

    a_d: np.ndarray
    a_k: np.ndarray
    a_0: np.ndarray
    W_k: np.ndarray
    xi: np.ndarray
    z: np.ndarray

    def flat(self) -> np.ndarray:
        """Return all that moves, everything but a_0, as one vector."""
        return np.concatenate([self.a_d, self.a_k, self.W_k.ravel(), self.xi, self.z])

    def with_flat(self, vector: np.ndarray) -> ControllerState:
        """Return the state whose ``flat`` is ``vector``."""
        d, k, m = self.a_d.size, self.a_k.size, self.xi.size
        end = d + k + m * k
        return ControllerState(
            a_d=vector[:d],
            a_k=vector[d : d + k],
            a_0=self.a_0,
            W_k=vector[d + k : end].reshape(m, k),
            xi=vector[end : end + m],
            z=vector[end + m :],
        )
