"""Rotations as unit quaternions xyzw and rotation vectors phi = log(R), world axes.

T. Barfoot, *State Estimation for Robotics*, 2017, section 7.1: with Jl the left Jacobian of SO(3),
a rotation E with angular velocity omega has d log(E)/dt = Jl^-1(phi) omega, Jl^-1(phi) = I -
[phi]/2 + c [phi]^2, c = (1 - (t/2) cot(t/2)) / t^2, t = |phi|. Written in plain floats, which for
four numbers are several times faster than arrays.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pinocchio as pin

_SERIES = 0.05  # [rad] below which c is computed from its series, correct to 1e-14


def quaternion(R: np.ndarray) -> np.ndarray:
    """Return a rotation matrix (3, 3) as a unit quaternion xyzw (4); its sign is arbitrary."""
    return np.asarray(pin.Quaternion(R).coeffs())


def matrix(q: np.ndarray) -> np.ndarray:
    """Return the rotation matrix (3, 3) of a quaternion xyzw (4) of any length but zero."""
    x, y, z, w = q
    return np.asarray(pin.Quaternion(w, x, y, z).normalized().toRotationMatrix())


def turned(q: np.ndarray, phi: np.ndarray) -> np.ndarray:
    """Return the quaternion (4) of exp(phi) R: q (4) turned by phi (3) [rad] in world axes."""
    return quaternion(pin.exp3(np.asarray(phi, dtype=float)) @ matrix(q))


def rotation_between(q: Sequence[float], q_d: Sequence[float]) -> tuple[float, float, float]:
    """Return phi (3) [rad], |phi| <= pi, exp(phi) = R R_d^T, for quaternions xyzw of R, R_d."""
    x, y, z, w = q
    a, b, c, s = q_d
    scalar = w * s + x * a + y * b + z * c
    i = s * x - w * a + z * b - y * c  # q times the conjugate of q_d
    j = s * y - w * b + x * c - z * a
    k = s * z - w * c + y * a - x * b
    sine = math.sqrt(i * i + j * j + k * k)
    if sine == 0.0:
        return 0.0, 0.0, 0.0
    factor = (
        2.0 * (math.atan2(sine, scalar) if scalar >= 0.0 else -math.atan2(sine, -scalar)) / sine
    )
    return factor * i, factor * j, factor * k


def rotation_drift(
    phi: Sequence[float], omega: Sequence[float], omega_d: Sequence[float]
) -> tuple[float, float, float]:
    """Return dphi/dt - (omega - omega_d) (3) [rad/s] for exp(phi) = R R_d^T.

    E = R R_d^T has the angular velocity omega - E omega_d, and Jl^-1 E is the transpose of Jl^-1,
    so dphi/dt = Jl^-1 omega - Jl^-T omega_d. The difference is phi x (c phi x (omega - omega_d) -
    (omega + omega_d) / 2). It is orthogonal to phi, so phi^T dphi/dt = phi^T (omega - omega_d).
    """
    x, y, z = phi
    c = _second_coefficient(math.sqrt(x * x + y * y + z * z))
    i, j, k = omega[0] - omega_d[0], omega[1] - omega_d[1], omega[2] - omega_d[2]
    a = c * (y * k - z * j) - 0.5 * (omega[0] + omega_d[0])
    b = c * (z * i - x * k) - 0.5 * (omega[1] + omega_d[1])
    d = c * (x * j - y * i) - 0.5 * (omega[2] + omega_d[2])
    return y * d - z * b, z * a - x * d, x * b - y * a


def _second_coefficient(angle: float) -> float:
    """Return (1 - (t/2) cot(t/2)) / t^2 at t = angle [rad]: 1/12 at zero, 1/pi^2 at pi."""
    square = angle * angle
    if angle < _SERIES:
        return 1.0 / 12.0 + square * (1.0 / 720.0 + square / 30240.0)
    half = 0.5 * angle
    return (1.0 - half * math.cos(half) / math.sin(half)) / square
