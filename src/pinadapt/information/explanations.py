"""What explains a change of an arm's bodies: a load, all inertias scaled, or links that are wrong.

Each explanation says that the bodies differ from their description by D = G theta, theta normal
with mean zero and unit covariance, and leaves the coefficients of the joints free. With R the
square root of the information of a run, c = R D of the least-squares estimate, both less what the
coefficients explain, and M = R G, the evidence for it is normal too:

    log p = -(c^T (1 + M M^T)^-1 c + log det(1 + M M^T)) / 2.

The determinant is the price of an explanation that could have explained much else. A load on an arm
as described has ten numbers and leaves all other combinations as they are: no accident lets wrong
links look like that. All inertias scaled by one number have the smallest price. Before the data, a
load on the arm as described has a probability of 0.9, as that is what is asked for. D. J. C.
MacKay, *Bayesian interpolation*, Neural Computation 4 (1992) 415-447.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .._table import Table
from ..models.pseudo_inertia import UNCERTAINTY
from ..models.regressor import PER_BODY
from .information import Information

AS_DESCRIBED = "the arm as described"  # first words of the plain explanation
SCALE = 0.5  # standard deviation of a common factor of all inertias
OFF = (0.003, 0.01, 0.03, 0.1, 0.3)  # shares by which bodies may be off, each by its own
_PLAIN = 0.9  # probability, before the data, that the arm is as described, as whoever asks says
_SURE = 0.95  # probability from which on there is a load


@dataclass(frozen=True, eq=False)
class Explanation:
    """One explanation of the change of the bodies.

    Attributes:
        words: what it says.
        probability: of it, relative to the others.
        explained: share, from 0 to 1, of the change that it accounts for.
        loaded: whether a load is part of it.
        load: (10) parameters of the load in the axes of the last joint; zero without one.
        covariance: (10, 10) of the load's parameters.
    """

    words: str
    probability: float
    explained: float
    loaded: bool
    load: np.ndarray
    covariance: np.ndarray

    @property
    def mass(self) -> float:
        """Mass of the load [kg]."""
        return float(self.load[0])

    @property
    def mass_known_to(self) -> float:
        """Standard deviation of the mass if the explanation is true [kg]."""
        return float(np.sqrt(self.covariance[0, 0]))


@dataclass(frozen=True, eq=False)
class _Fit:
    """A fitted explanation: log evidence, share explained, theta (k) and its covariance."""

    evidence: float
    explained: float
    theta: np.ndarray
    covariance: np.ndarray


def explanations(
    found: Information, known: np.ndarray, arm: np.ndarray, load: np.ndarray
) -> tuple[Explanation, ...]:
    """Return the explanations of a change of the bodies, the most probable one first.

    Args:
        found: information about k bodies, ten parameters each, and then the joints' coefficients.
        known: (p) the parameters of the description.
        arm: (p, l) L of the covariance L L^T of bodies that are off by 30 %, each by its own.
        load: (10, 10) root of the covariance of a load, in the axes of the last joint.
    """
    R, c = found.equations
    c = c + R @ (found.estimate - known)
    inertial = np.flatnonzero(arm.any(axis=1)).max(initial=-1) + 1
    Q, s, _ = np.linalg.svd(R[:, inertial:], full_matrices=False)
    Q = Q[:, s > np.finfo(float).eps * max(R.shape) * s.max(initial=0.0)]
    R, c = R - Q @ (Q.T @ R), c - Q @ (Q.T @ c)
    on_last, common = np.zeros((known.size, PER_BODY)), np.zeros((known.size, 1))
    on_last[inertial - PER_BODY : inertial] = load
    common[:inertial, 0] = SCALE * known[:inertial]
    none = np.zeros((known.size, 0))
    parts = [("arm", [none]), ("scale", [common])]
    parts.append(("off", [share / UNCERTAINTY * arm for share in OFF]))
    fits: list[tuple[str, bool, int, _Fit, float]] = []
    for name, roots in parts:
        for loaded in (True, False):
            if name == "arm" and not loaded:
                continue
            some = [_fit(R, c, np.hstack([on_last if loaded else none, root])) for root in roots]
            best = int(np.argmax([fit.evidence for fit in some]))
            mean = np.logaddexp.reduce([fit.evidence for fit in some]) - np.log(len(some))
            fits.append((name, loaded, best, some[best], float(mean)))
    odds = [np.log(_PLAIN if name == "arm" else (1.0 - _PLAIN) / 4.0) for name, *_ in fits]
    fits = [(*fit[:4], fit[4] + before) for fit, before in zip(fits, odds, strict=True)]
    total = np.logaddexp.reduce([evidence for *_, evidence in fits])
    made = [
        _explanation(name, loaded, best, fit, float(np.exp(evidence - total)), load)
        for name, loaded, best, fit, evidence in fits
    ]
    return tuple(sorted(made, key=lambda one: -one.probability))


def _fit(R: np.ndarray, c: np.ndarray, G: np.ndarray) -> _Fit:
    """Return the fit of c = R G theta + noise, both of unit covariance."""
    U, s, Vt = np.linalg.svd(R @ G, full_matrices=True)
    k = len(s)
    g, shrunk = U.T @ c, np.ones(len(c))
    shrunk[:k] = 1.0 / (1.0 + s**2)
    evidence = -0.5 * float(shrunk @ g**2 - np.sum(np.log(shrunk)))
    theta = Vt[:k].T @ (s * shrunk[:k] * g[:k])
    variances = np.ones(len(Vt))
    variances[:k] = shrunk[:k]
    rest, whole = float(np.sum((shrunk * g) ** 2)), float(g @ g)
    explained = 1.0 - rest / whole if whole > 0.0 else 1.0
    return _Fit(evidence, explained, theta, (Vt.T * variances) @ Vt)


def _explanation(
    name: str, loaded: bool, best: int, fit: _Fit, probability: float, root: np.ndarray
) -> Explanation:
    """Return an explanation in words, with its load."""
    load, covariance = np.zeros(PER_BODY), np.zeros((PER_BODY, PER_BODY))
    if loaded:
        load = root @ fit.theta[:PER_BODY]
        covariance = root @ fit.covariance[:PER_BODY, :PER_BODY] @ root.T
    factor = 1.0 + SCALE * float(fit.theta[-1])
    arm = {
        "arm": AS_DESCRIBED,
        "scale": f"all inertias {factor:.2f} times the described ones",
        "off": f"each body off by some {100.0 * OFF[best]:g} %",
    }[name]
    words = f"{arm}, and a load" if loaded else f"{arm}, and no load"
    return Explanation(words, probability, fit.explained, loaded, load, covariance)


def widened(
    load: np.ndarray, deviation: np.ndarray, gradient: np.ndarray, given: tuple[Explanation, ...]
) -> np.ndarray:
    """Return standard deviations (m) that cover the other explanations of a load.

    To the variance come, by the probability of each explanation but that of a load on the arm as
    described, its own variance and the square of its distance.

    Args:
        load: (10) parameters of the load on the arm as described.
        deviation: (m) of numbers of that load.
        gradient: (m, 10) of these numbers by the load's parameters.
        given: the explanations.
    """
    total = deviation**2
    for one in given:
        if not one.words.startswith(AS_DESCRIBED):
            apart = gradient @ (one.load - load)
            own = np.einsum("mi,ij,mj->m", gradient, one.covariance, gradient)
            total = total + one.probability * (apart**2 + np.maximum(own, 0.0))
    return np.asarray(np.sqrt(total))


def sure(given: tuple[Explanation, ...]) -> bool:
    """Tell whether some load is part of what explains the change; True without explanations."""
    return not given or sum(one.probability for one in given if one.loaded) >= _SURE


def explanation_table(given: tuple[Explanation, ...]) -> Table:
    """Return a table of the explanations: what they explain, how probable they are, their load."""
    rows = [
        (
            one.words,
            f"{one.explained:.3%}",
            f"{one.probability:.3f}",
            f"{one.mass:.4g} +- {one.mass_known_to:.2g} kg" if one.loaded else "none",
        )
        for one in given
    ]
    return Table(rows, ("explanation of the data", "explains", "probability", "load"))
