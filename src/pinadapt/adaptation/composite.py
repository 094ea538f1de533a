"""Composite adaptation: tracking error and prediction error of the torque together.

``Composite`` uses the prediction error of the present, ``CompositeMemory`` that of all past data.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy import empty
from numpy.typing import ArrayLike

from .._checks import numbers, positive
from .._compiled import compile_all
from .._kernels import estimates as kernels
from ..exceptions import ArrayError, GainError
from .adaptation import Adaptation, Drive, Estimate, Wrapper, are_arrays
from .least_squares import DecayWeight, checked_weight, weight_of

# name of the inner adaptation -> name of the wrapped one
_COMPOSITE = {"gradient": "composite", "natural": "natural-composite"}
_WITH_MEMORY = {"gradient": "composite-memory", "natural": "natural-memory"}


class Composite(Wrapper):
    """da/dt = -Gamma (Y^T e + W^T R r), r = W a - y, Gamma that of any adaptation.

    W and y are the filtered regressor and torque of the joints; see ``FilteredRegressor``. For the
    true parameters W a = y, hence r = W da for any tracking error, and adaptation continues when
    the tracking error has vanished.

    V:          dV/dt changes by -r^T R r <= 0, an equality for every R >= 0, which may change with
                time, in the metric of any inner adaptation. Under natural adaptation the estimate
                stays in its cone.
    Weight:     constant, as published, or R = rate (W Gamma W^T + diag(floor))^-1; see
                ``DecayWeight``.

    J.-J. Slotine, W. Li, *Composite adaptive control of robot manipulators*, Automatica 25 (1989)
    509-519, with a constant Gamma; with natural adaptation it is the same gradient in its metric.

    Attributes:
        inner: the wrapped adaptation, of all dynamic parameters.
        torque_bandwidth: bandwidth of the low pass [1/s].
    """

    sources: tuple[str, ...] = ("SlotineLi1989",)

    def __init__(
        self,
        inner: Adaptation,
        bandwidth: float,
        *,
        weight: ArrayLike | None = None,
        rate: float | None = None,
        floor: ArrayLike = 0.0,
    ) -> None:
        """Wrap an adaptation; the prediction error has either a weight or a rate.

        Args:
            inner: any adaptation.
            bandwidth: of the low pass [1/s].
            weight: R, a number, n numbers or (n, n), in 1 / (N m)^2 or 1 / N^2.
            rate: [1/s] at which the prediction error decays, instead of a weight.
            floor: with a rate: a positive number or n of them, in units of W Gamma W^T.

        Raises:
            GainError: neither or both of weight and rate, or gains that are not positive.
        """
        super().__init__(inner)
        self.name = _COMPOSITE.get(inner.name, inner.name)
        self.torque_bandwidth = positive(bandwidth, "prediction_filter")
        if (weight is None) == (rate is None):
            raise GainError("expected either a weight or a rate.", where="prediction_rate")
        self._constant = None if weight is None else checked_weight(weight)
        self._decay = None if rate is None else DecayWeight(rate, floor)

    def weight(self, value: np.ndarray, W: np.ndarray) -> np.ndarray:
        """Return R (n, n) at a value (p) and a filtered regressor W (n, p)."""
        if self._constant is not None:
            return weight_of(self._constant, len(W))
        assert self._decay is not None
        return self._decay.at(W.dot(self.inner.gain_times_unchecked(value, W.T)))

    weight_unchecked = weight

    def rate(self, estimate: Estimate, drive: Drive) -> Estimate:
        """Return the inner adaptation's rates under tracking and prediction error."""
        return self.inner.rate_unchecked(estimate, self._weighted(estimate, drive))

    def step(self, estimate: Estimate, drive: Drive, dt: float) -> Estimate:
        """Return the inner adaptation's estimate after dt [s] under both errors, held."""
        return self.inner.step_unchecked(estimate, self._weighted(estimate, drive), dt)

    def dissipation(self, estimate: Estimate, drive: Drive, truth: np.ndarray) -> float:
        """Return -r^T R r, and what the inner adaptation adds to dV/dt."""
        own, weighted = 0.0, self._weighted(estimate, drive)
        if weighted.W is not None and weighted.weight is not None:
            predicted = weighted.W.dot(estimate.value - truth)
            own = -float(predicted @ weighted.weight @ weighted.residual)
        return own + self.inner.dissipation_unchecked(estimate, weighted, truth)

    def _weighted(self, estimate: Estimate, drive: Drive) -> Drive:
        """Return the drive with its weight R; unchanged without a prediction error."""
        W = drive.W
        return drive if W is None else drive.weighted(self.weight_unchecked(estimate.value, W))


class _Recalled(NamedTuple):
    """What the memory says about an estimate.

    Attributes:
        pull: (p) H da, the gradient that the memory adds, times the share of rho that holds now.
        surprise: d, the normalised innovation.
        innovation: (n) r_m [N m or N].
        fading: mu, the rate at which it is forgotten now [1/s].
    """

    pull: np.ndarray
    surprise: float
    innovation: np.ndarray
    fading: float


class _Clock(NamedTuple):
    """Numbers of the memory's state; times in s.

    Attributes:
        quiet: until the low pass has forgotten what it knew before a new start.
        due: until the next look.
        fresh: exp(-bandwidth t) at a time t after a new start.
        left: the same after ``origin`` was taken.
        usual: mean of d.
        unexplained: mean size of the innovations that last.
        residual: mean square of the prediction errors at the last look, relative to the noise.
    """

    quiet: float
    due: float
    fresh: float
    left: float
    usual: float
    unexplained: float
    residual: float


class _Factors(NamedTuple):
    """I + A P of the next look, as far as it has been made.

    Attributes:
        matrix: (p, p) kappa (I + A P), or its triangular factors; (0, 0) before.
        pivots: (p) of the factors, or empty.
        value: (p) estimate that P belongs to.
    """

    matrix: np.ndarray
    pivots: np.ndarray
    value: np.ndarray


_NOTHING = np.zeros(0)
_UNMADE = _Factors(np.zeros((0, 0)), np.zeros(0, dtype=np.int32), _NOTHING)
# places of the numbers and of Pi a_0, and parts before those of the inner adaptation
_CLOCK, _START, _OWN = 6, 10, 11
# in time constants of the low pass
_QUIET = 6.0  # after which it knows 0.2 % of an old load
_RISE, _FALL = 20.0, 40.0  # over which innovations are averaged, if they rise or fall
_LASTING = 10.0  # of innovations that do not alternate
_FORGOTTEN = 1e-6  # share of the origin that is left out
_SETTLED = math.exp(-10.0)  # share of fresh after which it may begin anew again
_UNUSUAL = 10.0  # times the usual innovation
_FIRST = 3e-3  # innovation that is usual at a new start
_CALM = 0.1  # least share of rho
_SHORT = 0.1  # of the interval: periods below it prepare a look in the samples before
_IN_TIME = 2e-3  # [s] lateness below which the tracking error adapts faster
_UNKNOWN = 0.1  # [s] lateness beside an empty memory
_AT_REST = 1e-6, 1e-2  # mean squares of errors and their rates at rest


class CompositeMemory(Wrapper):
    """da/dt = -Gamma (Y^T e + (rho / kappa) H da), H = A (I + P A)^-1, P = Gamma / kappa.

    Gamma is that of any adaptation, and P the covariance that the memory takes for that of da. A
    and b accumulate the information in the filtered regressor W and torque y of the joints,
    weighted by R = bandwidth diag(noise)^-2:

        dA/dt = W^T R W - mu A,     db/dt = W^T R y - mu b,     A(0) = 0, b(0) = 0.

    For the true parameters W a = y and hence b = A a. So A da = A a_hat - b contains only known
    quantities, and H da = (I + A P)^-1 (A a_hat - b). Composite adaptation uses the n
    combinations of parameters that W shows at one instant; this uses all those that the motion has
    excited so far.

    Other data: A and b may begin with the information of a recorded motion, see ``informed``.

    V:          dV/dt changes by -(rho / kappa) da^T H da, an equality for all mu >= 0 and R >= 0,
                which may change with time, in the metric of any inner adaptation. H is symmetric
                and positive semidefinite: H^-1 = A^-1 + P where A is invertible. Under natural
                adaptation the estimate stays in its cone.
    Share:      written with P, da/dt = -P (kappa Y^T e + rho H da), and kappa V has the derivative
                kappa (that of the law) - rho da^T H da. With kappa below one the tracking error
                adapts more slowly than the memory, which needs no fast loop of torque and estimate
                for its accuracy: such a loop rings where motors are late or joints are elastic.
    Rate:       errors in directions with much information, P A >> 1, decay as exp(-rho t). A
                need not have full rank for that, and excitation need not persist. The eigenvalues
                of rho P H are at most rho, so a step is stable for every period below 2 / rho.
    Agreement:  where memory and estimate nearly agree on the torque, rho is reduced, to a tenth at
                least: rho m / (m + agreement), m the root mean square over the joints of W P H da /
                noise. Errors that no parameters cause, such as those of sampling, are then left to
                the tracking error, which compensates them as an integrator does.
    Fading:     1 / mu = 1 / (forgetting d) + 1 / bandwidth, d the normalised innovation of least
                squares, d = r_m^T (S + diag(noise)^2)^-1 r_m / n. r_m is the prediction error of
                the memory's own estimate a_hat - P H da; S = W (P^-1 + A)^-1 W^T is the
                part of its covariance that comes from too little data. So data are forgotten when
                new ones contradict them, at most at the bandwidth of the low pass; otherwise they
                are kept.
    New start:  where d exceeds ``contradiction`` and ten times its own mean, for example after a
                change of the load, at most once in 10 / bandwidth, and at an announcement: A = 0
                and b = 0. V does not contain A and b. What the low pass still knows of the old load
                is subtracted: with W_0, y_0 at the new start, t ago, W - exp(-bandwidth t) W_0 and
                y - exp(-bandwidth t) y_0 are those of a low pass that started then, so new data
                count at once. The mean of d, over 20 / bandwidth where it rises and 40 / bandwidth
                where it falls, is for errors that no parameters explain: they contradict all data
                alike.
    Onset:      kappa(t) = kappa + (kappa_1 - kappa) exp(-bandwidth t) at a time t after a new
                start. An empty memory contributes nothing; meanwhile the tracking error adapts as
                fast as without one. V = kappa(t) (that of the law) + D, D in the metric P^-1, has
                the derivative kappa (dV/dt of the law) + dkappa/dt (the law's V) - rho da^T H da:
                with dkappa/dt <= 0 and a law's V >= 0 it decreases at least as fast as with a
                constant kappa. At a new start kappa, and with it V, jumps up. ``emphasis`` is
                kappa(t) / kappa, for V in the metric Gamma^-1, this V over kappa. Where torques are
                in time, (kappa_3 - kappa) (1 - T / 2 ms) is added, T the lateness
                below: a tracking error that adapts faster compensates more of what sampling
                leaves, and rings only where torques are late. V may rise by dkappa/dt (the law's V)
                while T falls.
    Mismatch:   where there is a tracking error, innovations that last contradict the assumption
                W a = y itself, as friction does that is in no parameter. With q^2 the mean square
                of the innovations, scaled to d and averaged over 10 / bandwidth with their signs,
                rho is multiplied by 1 / (1 + (q^2 / unexplained)^2), or ``least_trust`` where that
                is larger, and kappa(t) is at least the complementary share of kappa_2. A least
                trust is for models that explain all joints' friction: innovations that last then
                come from a prior that is far too narrow, such as that of a wrist with a heavy load,
                and only the memory corrects that. Where nothing is explained this is the inner
                adaptation at that share of its speed. V may rise by dkappa/dt (the law's V) while
                q^2 rises.
    Prior:      where W is noisy, least squares is biased (errors in variables): E W^T R W grows by
                the information N of the noise per second, E W^T R y does not, so that a direction
                that no motion shows tends to N a = 0, and inertias that vanish beside first moments
                that are known make masses grow. With Pi for a prior, dA/dt gains Pi and db/dt gains
                Pi a_0, a_0 the value at the start or the announced one. A direction without motion
                tends to (N + Pi)^-1 Pi a_0, and what a motion shows with information A per second
                is off by A^-1 (Pi (a_0 - a) - N a), however long the run is. dV/dt gains
                (rho / kappa) da^T (I + A P)^-1 Pi (a_0 - a) t.
    Lateness:   T with T^2 = mean |r_m|^2 / mean |dy/dt|^2, both relative to the noise and averaged
                over 20 / bandwidth, is the time by which the torques would have to be late to leave
                such errors (``Estimate.lateness``). Motors that are late by T do, unless parameters
                explain a part; a ringing, springs and encoders leave more. An empty memory explains
                everything: at a new start T is 0.1 s, and decays over 40 / bandwidth to what the
                new data say. Motors whose lateness W and y already hold are ``late`` besides. T is
                10 ms while all rests, and infinite while a motor saturates; as
                part of an ODE it does not move.
    Limits:     while a motor saturates, the missing torque may be that of an obstacle. The memory
                then stores nothing and adds nothing; afterwards it goes on as if its low pass
                started there.
    Sampling:   A and b are integrated, and H da, which needs the solution of p equations, is
                evaluated and held over steps of ``interval``; a prediction error that grows like a
                contradiction is looked at immediately. The two samples before a look make I + A P
                and its factors, so that no sample pays for all: P is then that of two samples ago.
                V does not notice, as H is positive semidefinite for every P. A period longer than a
                tenth of the interval has time for all at once, and P changes more meanwhile. As
                part of an ODE (``rate``) all are continuous; the memory neither begins anew nor
                trusts itself less, and is quiet for 6 / bandwidth after an announcement.

    G. Kreisselmeier, *Adaptive observers with exponential rate of convergence*, IEEE TAC 22 (1977)
    2-8 (the integrals); Y. Pan, H. Yu, *Composite learning robot control with guaranteed parameter
    convergence*, Automatica 89 (2018) 398-406 (such a memory beside the tracking error);
    T. Fortescue, L. Kershenbaum, B. Ydstie, *Implementation of self-tuning regulators with variable
    forgetting factors*, Automatica 17 (1981) 831-835 (forgetting by the innovation). New here are
    any metric, and H in place of a constant gain on A a_hat - b, for which A is too stiff.

    Attributes:
        inner: the wrapped adaptation, of all dynamic parameters.
        torque_bandwidth: bandwidth of the low pass [1/s]; its inverse is the correlation time
            assumed for the noise.
        speed: rho [1/s].
        noise: standard deviation of the torques, one number or (n) [N m or N].
        forgetting: [1/s] at an innovation as large as expected; zero never forgets.
        share: kappa.
        first_share: kappa_1, share of the tracking error beside an empty memory.
        lone_share: kappa_2, its share beside a memory that explains nothing.
        timely_share: kappa_3, its share where torques are in time.
        contradiction: d above which the memory begins anew; infinite for never.
        unexplained: q^2 at which the memory is trusted by half; infinite for always wholly.
        least_trust: from 0 to 1, that lasting innovations leave.
        interval: between evaluations of H da [s]; zero for every sample.
        agreement: size of the torques that memory and estimate differ by, relative to the noise,
            below which rho is reduced; zero for never.
        unit: the parameters' covariance before any data is about ``unit`` P: P is the rate of a
            loop, and larger.
        prior: Pi (p, p) [1/s], or None.
        late: by which torques come late that W and y hold in time [s].
    """

    sources = ("Kreisselmeier1977", "PanYu2018", "FortescueKershenbaumYdstie1981")

    def __init__(
        self,
        inner: Adaptation,
        bandwidth: float,
        *,
        rate: float,
        noise: ArrayLike,
        forgetting: float = 0.0,
        share: float = 1.0,
        first_share: float | None = None,
        lone_share: float | None = None,
        timely_share: float | None = None,
        contradiction: float = math.inf,
        unexplained: float = math.inf,
        least_trust: float = 0.0,
        interval: float = 0.0,
        agreement: float = 0.0,
        unit: float = 1.0,
        prior: ArrayLike | None = None,
        late: float = 0.0,
    ) -> None:
        """Wrap an adaptation with a memory.

        Args:
            inner: any adaptation, whose metric is used.
            bandwidth: of the low pass on torque and regressor [1/s].
            rate: rho [1/s].
            noise: standard deviation of the torques, one number or n [N m or N].
            forgetting: rate of fading at an innovation as large as expected [1/s].
            share: kappa in (0, 1], Gamma / P.
            first_share: kappa_1 from kappa to 1; None: kappa.
            lone_share: kappa_2, the same.
            timely_share: kappa_3, the same.
            contradiction: normalised innovation above which the memory begins anew; infinite:
                never.
            unexplained: mean square of lasting innovations at which the memory is trusted by half;
                infinite: always wholly.
            least_trust: from 0 to 1, that is left of it at the largest ones.
            interval: between evaluations of H da [s], at most 1 / rho; zero: every sample.
            agreement: below which difference of the torques, relative to the noise, rho is reduced.
            unit: of P, by which information of other data is multiplied.
            prior: Pi (p, p) [1/s], symmetric and positive semidefinite; None: zero.
            late: by which torques come late that W and y hold in time [s].

        Raises:
            GainError: gains that are not positive, shares above one or below kappa, a trust above
                one, too long an interval, or a prior that is no square matrix.
        """
        super().__init__(inner)
        self.name = _WITH_MEMORY.get(inner.name, inner.name)
        self.torque_bandwidth = self._bandwidth = positive(bandwidth, "prediction_filter")
        self.speed = positive(rate, "prediction_rate")
        self.noise = numbers(noise, "noise", error=GainError)
        if self.noise.ndim > 1 or not (self.noise > 0.0).all():
            raise GainError("expected a positive number, or one per joint.", where="noise")
        self.forgetting = positive(forgetting, "forgetting", zero=True)
        self.share = positive(share, "share")
        if self.share > 1.0:
            raise GainError(
                f"the tracking error may adapt at most as fast as the memory, got {share:g} > 1.",
                where="share",
            )
        self.first_share = self._greater(first_share, "first_share")
        self.lone_share = self._greater(lone_share, "lone_share")
        self.timely_share = self._greater(timely_share, "timely_share")
        self.contradiction = _positive_or_infinite(contradiction, "contradiction")
        self.unexplained = _positive_or_infinite(unexplained, "unexplained")
        self.least_trust = positive(least_trust, "least_trust", zero=True)
        if self.least_trust > 1.0:
            raise GainError(f"must be at most 1, got {self.least_trust:g}.", where="least_trust")
        self.interval = positive(interval, "interval", zero=True)
        if self.interval * self.speed > 1.0:
            raise GainError(
                f"{interval:g} s is longer than 1 / rho = {1.0 / self.speed:.3g} s.",
                where="interval",
            )
        self.agreement = positive(agreement, "agreement", zero=True)
        self.unit = positive(unit, "unit")
        self.prior = None if prior is None else numbers(prior, "prior", error=GainError)
        if self.prior is not None and self.prior.shape != 2 * self.prior.shape[:1]:
            raise GainError(
                f"expected a square matrix, got shape {self.prior.shape}.", where="prior"
            )
        self.late = positive(late, "late", zero=True)
        compile_all()
        self._variance = self.noise * self.noise
        self._precision = np.atleast_1d(1.0 / self._variance)

    def init(self, value: np.ndarray) -> Estimate:
        """Return the inner adaptation's start, with an empty memory."""
        return self._with_empty_memory(self.inner.init(value), value, 0.0)

    def informed(self, estimate: Estimate, H: np.ndarray) -> Estimate:
        """Return the estimate with A = unit H and b = A a_hat.

        Where the other data's best value is off by e, dV/dt changes by (rho / kappa) da^T
        (I + A P)^-1 A e besides: the memory keeps the other data with the stated accuracy.
        """
        A = self.unit * H
        return Estimate(estimate.value, (A, A.dot(estimate.value), *estimate.memory[2:]))

    def reset_to(self, estimate: Estimate, value: np.ndarray, start: np.ndarray) -> Estimate:
        """Return the inner adaptation's estimate at an announced value (p); memory begins anew."""
        inner = self.inner.reset_to(self._inner(estimate), value, start)
        return self._with_empty_memory(inner, start, _QUIET / self._bandwidth)

    def recorded(self, estimate: Estimate) -> Estimate:
        """Return the estimate with what V needs of the memory: the numbers that kappa follows."""
        inner = self.inner.recorded_unchecked(self._inner(estimate))
        own = [_NOTHING] * _OWN
        own[_CLOCK] = estimate.memory[_CLOCK]
        return Estimate(inner.value, (*own, *inner.memory), estimate.lateness)

    def _remembers(self, memory: tuple) -> bool:
        """Return whether a memory begins with the parts of this one, or with those of a record.

        A record keeps the numbers and nothing else.
        """
        own, inner = memory[:_OWN], memory[_OWN:]
        if len(own) < _OWN or not all(isinstance(part, np.ndarray) for part in own):
            return False
        _, b, _, origin, lasting, heard, numbers_now, matrix, pivots, value, start = own
        p, n = b.size, lasting.size
        fits = are_arrays((numbers_now,), (len(_Clock._fields),)) and self.inner._remembers(inner)
        if all(not part.size for part in own[:_CLOCK] + own[_CLOCK + 1 :]):
            return fits
        made, looks = len(value), len(origin)
        return (
            fits
            and (self._size in (None, p) and made in (0, p) and self.noise.size in (1, n))
            and are_arrays(own[:3], (p, p), (p,), (p,))
            and are_arrays((origin, lasting), (looks, p + 1), (n,))
            and are_arrays((heard, matrix, value), (heard.size,), (made, made), (made,))
            and heard.size in (2, 2 + n)
            and are_arrays((start,), (0 if self.prior is None else p,))
            and pivots.dtype.kind in "fi"
            and pivots.shape in ((0,), (made,))
        )

    def emphasis(self, estimate: Estimate) -> float:
        """Return kappa(t) / kappa."""
        return self._emphasis(_Clock(*estimate.memory[_CLOCK].tolist()), estimate.lateness)

    def rate(self, estimate: Estimate, drive: Drive) -> Estimate:
        """Return the inner adaptation's rates under drive and memory, dA/dt, db/dt, dkappa/dt."""
        A, b = estimate.memory[:2]
        clock, inner = _Clock(*estimate.memory[_CLOCK].tolist()), self._inner(estimate)
        told = None
        if clock.quiet <= 0.0 and not drive.saturated:
            told = self._recalled(estimate, drive)
        rate = self.inner.rate_unchecked(
            inner, self._total(drive, None if told is None else told.pull, clock, estimate.lateness)
        )
        still = [np.zeros(part.shape) for part in estimate.memory[:_OWN]]
        if told is not None:
            A_new, b_new = self._news(estimate, drive)
            still[0], still[1] = A_new - told.fading * A, b_new - told.fading * b
        fades = -self._bandwidth
        still[_CLOCK][:4] = (
            -float(clock.quiet > 0.0),
            0.0,
            fades * clock.fresh,
            fades * clock.left,
        )
        return Estimate(rate.value, (*still, *rate.memory))

    def step(self, estimate: Estimate, drive: Drive, dt: float) -> Estimate:
        """Return the estimate after dt [s] with the drive held; fading is integrated exactly."""
        A, b, pull, origin, lasting, heard, numbers_now, *made, start = estimate.memory[:_OWN]
        clock, factors = _Clock(*numbers_now.tolist()), _Factors(*made)
        inner, late = self._inner(estimate), estimate.lateness
        fades, passed = math.exp(-self._bandwidth * dt), empty(len(clock))
        kernels.let_pass(numbers_now, dt, fades, passed)
        if drive.W is None or drive.residual is None or drive.saturated:
            after = self.inner.step_unchecked(inner, self._total(drive, None, clock, late), dt)
            later = _Clock(*passed.tolist())._replace(quiet=_QUIET / self._bandwidth, due=0.0)
            memory = A, b, pull, origin, lasting, heard, np.array(later), *_UNMADE, start
            return Estimate(after.value, (*memory, *after.memory))
        if clock.quiet > 0.0:
            after = self.inner.step_unchecked(inner, self._total(drive, None, clock, late), dt)
            later = _Clock(*passed.tolist())._replace(quiet=0.0, left=fades)
            origin = _origin(estimate.value, drive)
            heard = np.concatenate([heard[:2], origin[:, -1]])
            memory = A, b, pull, origin, lasting, heard, np.array(later), *_UNMADE, start
            return Estimate(after.value, (*memory, *after.memory))
        whole = drive
        if clock.left < _FORGOTTEN:
            origin = origin[:0]
        elif len(origin):
            drive = _since(origin, clock.left, estimate.value, drive)
        assert drive.residual is not None
        size, due = kernels.mean_square(drive.residual, self._precision), clock.due
        known = _UNUSUAL * max(clock.usual, clock.residual)
        if due > 0.5 * dt and size <= max(self.contradiction, known):
            after = self.inner.step_unchecked(inner, self._total(drive, pull, clock, late), dt)
            if due < 2.5 * dt and dt < _SHORT * self.interval:
                factors = self._prepared(factors, estimate.value, A, last=due < 1.5 * dt)
            memory = A, b, pull, origin, lasting, heard, passed, *factors, start
            return Estimate(after.value, (*memory, *after.memory), late)
        told = self._recalled(estimate, drive, factors if factors.pivots.size else None)
        assert told is not None
        span, d = max(self.interval, dt), told.surprise
        usual = self._mean(clock.usual, d, span)
        later = _Clock(*passed.tolist())._replace(due=span - dt, residual=size, usual=usual)
        if clock.fresh < _SETTLED and d > max(self.contradiction, _UNUSUAL * later.usual):
            later = later._replace(due=0.0, fresh=1.0, usual=max(later.usual, _FIRST))
            after = self.inner.step_unchecked(inner, self._total(drive, None, later, late), dt)
            nothing = np.zeros(A.shape), np.zeros(b.size), np.zeros(b.size)
            later = later._replace(fresh=fades, left=fades)
            taken = _origin(estimate.value, whole)
            heard = np.concatenate([np.zeros(2), taken[:, -1]])
            memory = *nothing, taken, lasting, heard, np.array(later), *_UNMADE, start
            return Estimate(after.value, (*memory, *after.memory), _UNKNOWN)
        after = self.inner.step_unchecked(inner, self._total(drive, told.pull, clock, late), dt)
        kept = math.exp(-told.fading * span)
        A_new, b_new = self._news(estimate, drive, span)
        A_new += A if kept == 1.0 else kept * A
        now = told.innovation / self.noise
        now *= math.sqrt(d * now.size / max(float(now @ now), 1e-300))
        lasting = lasting + min(1.0, span * self._bandwidth / _LASTING) * (now - lasting)
        size = math.sqrt(float(lasting @ lasting) / lasting.size)
        later = later._replace(unexplained=self._mean(clock.unexplained, size, span))
        heard = self._heard(heard, estimate.value, whole, told.innovation, span - max(due, 0.0))
        if clock.fresh > _SETTLED:  # the memory explains all that it has seen
            heard[:2] = 0.0
        lateness = self._lateness(heard, clock)
        memory = (
            A_new, kept * b + b_new, told.pull, origin, lasting, heard, np.array(later), *_UNMADE,
            start,
        )  # fmt: skip
        return Estimate(after.value, (*memory, *after.memory), lateness)

    def dissipation(self, estimate: Estimate, drive: Drive, truth: np.ndarray) -> float:
        """Return -(rho / kappa) da^T H da, and what the inner adaptation adds to dV/dt."""
        clock = _Clock(*estimate.memory[_CLOCK].tolist())
        told = None
        if clock.quiet <= 0.0 and not drive.saturated:
            told = self._recalled(estimate, drive)
        total = self._total(drive, None if told is None else told.pull, clock, estimate.lateness)
        pulled = total.gradient - self._emphasis(clock, estimate.lateness) * drive.gradient
        own = -float((estimate.value - truth).dot(pulled))
        return own + self.inner.dissipation_unchecked(self._inner(estimate), total, truth)

    def storage(self, estimate: Estimate, truth: np.ndarray) -> float | None:
        """Return the inner adaptation's part of V."""
        return self.inner.storage_unchecked(self._inner(estimate), truth)

    @property
    def projects(self) -> bool:
        """Whether the inner adaptation projects."""
        return self.inner.projects

    def project(self, estimate: Estimate, q: np.ndarray) -> np.ndarray:
        """Return the value (p) that the inner adaptation uses at q (nq)."""
        return self.inner.project_unchecked(self._inner(estimate), q)

    def metric(self, estimate: Estimate) -> np.ndarray:
        """Return the inner adaptation's Gamma (p, p) at an estimate with its memory."""
        return self.inner.metric(self._inner(estimate))

    def _trust(self, clock: _Clock) -> float:
        """Return the share of rho that holds where some innovations last."""
        ratio = clock.unexplained * clock.unexplained / self.unexplained
        return max(1.0 / (1.0 + ratio * ratio), self.least_trust)

    def _emphasis(self, clock: _Clock, lateness: float) -> float:
        """Return kappa(t) / kappa."""
        first = 1.0 + (self.first_share / self.share - 1.0) * clock.fresh
        if lateness < _IN_TIME:
            first += (self.timely_share / self.share - 1.0) * (1.0 - lateness / _IN_TIME)
        return max(first, (1.0 - self._trust(clock)) * self.lone_share / self.share)

    def _greater(self, share: float | None, name: str) -> float:
        """Return a share between kappa and one, kappa for None.

        Raises:
            GainError: it is another number.
        """
        if share is None:
            return self.share
        if not self.share <= positive(share, name) <= 1.0:
            raise GainError(f"expected {self.share:g} to 1, got {share:g}.", where=name)
        return share

    def _total(
        self, drive: Drive, pull: np.ndarray | None, clock: _Clock, lateness: float
    ) -> Drive:
        """Return the drive of the inner adaptation, with the pull H da (p) of the memory."""
        emphasis = self._emphasis(clock, lateness)
        if pull is None:
            return Drive(drive.Y, drive.e, gradient=emphasis * drive.gradient)
        trust, gradient = 1.0 if drive.e is None else self._trust(clock), empty(pull.size)
        kernels.combine(emphasis, drive.gradient, trust * self.speed / self.share, pull, gradient)
        return Drive(drive.Y, drive.e, gradient=gradient)

    def _heard(
        self,
        before: np.ndarray,
        value: np.ndarray,
        drive: Drive,
        innovation: np.ndarray,
        elapsed: float,
    ) -> np.ndarray:
        """Return mean squares of r_m and dy/dt, relative to the noise, and y: an array (n + 2).

        Args:
            before: the same at the last look; without y, where that was zero.
            value: (p) the estimate.
            drive: with its prediction error.
            innovation: (n) r_m [N m or N].
            elapsed: since the last look [s].
        """
        assert drive.W is not None and drive.residual is not None
        y = drive.W.dot(value) - drive.residual
        change = y - before[2:] if before.size > 2 else y
        share = min(1.0, elapsed * self._bandwidth / _RISE)
        now = np.empty(2 + y.size)
        now[0] = before[0] + share * (kernels.mean_square(innovation, self._precision) - before[0])
        now[1] = before[1] + share * (
            kernels.mean_square(change, self._precision) / elapsed**2 - before[1]
        )
        now[2:] = y
        return now

    def _lateness(self, heard: np.ndarray, clock: _Clock) -> float:
        """Return T [s]."""
        errors, rates = heard[0] + _AT_REST[0], heard[1] + _AT_REST[1]
        doubt = _UNKNOWN * _UNKNOWN * clock.fresh ** (1.0 / _RISE)
        return self.late + math.sqrt(doubt + errors / rates)

    def _mean(self, mean: float, value: float, span: float) -> float:
        """Return a mean after a time [s], the faster where it rises."""
        over = _RISE if value > mean else _FALL
        return mean + min(1.0, span * self._bandwidth / over) * (value - mean)

    def _news(
        self, estimate: Estimate, drive: Drive, span: float = 1.0
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return W^T R W + Pi (p, p) and W^T R y + Pi a_0 (p) of a prediction error, times a span.

        They are rates, of A and b; span is the time over which they hold [s].
        """
        W, residual = drive.W, drive.residual
        assert W is not None and residual is not None
        weighted = (W.T * (span * self._bandwidth / self._variance)).dot  # W^T R
        A_new, b_new = weighted(W), weighted(W.dot(estimate.value) - residual)
        if self.prior is not None:
            A_new += span * self.prior
            b_new += span * estimate.memory[_START]
        return A_new, b_new

    def _prepared(self, made: _Factors, value: np.ndarray, A: np.ndarray, last: bool) -> _Factors:
        """Return the next part of what a look needs; the last sample before it factorises."""
        if last:
            return _factorised(made) if made.value.size else made
        if A.shape != 2 * value.shape:
            raise ArrayError
        moved = self.inner.gain_times_unchecked(value, A)  # kappa P A
        moved.flat[:: value.size + 1] += self.share
        return _Factors(moved.T, _UNMADE.pivots, value)

    def _recalled(
        self, estimate: Estimate, drive: Drive, made: _Factors | None = None
    ) -> _Recalled | None:
        """Return H da, d, r_m and mu; None without a prediction error.

        One factorisation of I + A P serves H da and S: one that was made, or a new one.
        """
        value, (A, b) = estimate.value, estimate.memory[:2]
        W, residual = drive.W, drive.residual
        if W is None or residual is None:
            return None
        from scipy.linalg.lapack import dgetrs  # slow to import

        n, p = W.shape
        if made is None:
            made = _factorised(self._prepared(_UNMADE, value, A, last=False))
        sides = np.empty((p, n + 1), order="F")
        sides[:, 0], sides[:, 1:] = A.dot(value) - b, W.T
        # (I + A P)^-1 / kappa times A da and W^T
        solved = dgetrs(made.matrix, made.pivots, sides, overwrite_b=True)[0]
        W_Gamma = self.inner.gain_times_unchecked(made.value, W.T).T
        pull, change = self.share * solved[:, 0], W_Gamma.dot(solved[:, 0])
        innovation = residual - change
        S = W_Gamma.dot(solved[:, 1:])
        S.flat[:: n + 1] += self._variance
        surprise = max(kernels.squared_ratio(innovation, S), 0.0) / n
        fading = self.forgetting * surprise
        fading /= 1.0 + fading / self._bandwidth
        return _Recalled(self._calm(change) * pull, surprise, innovation, fading)

    def _calm(self, change: np.ndarray) -> float:
        """Return the share of rho where the memory would change the torque by so much (n)."""
        if not self.agreement:
            return 1.0
        m = math.sqrt(kernels.mean_square(change, self._precision))
        return max(_CALM, m / (m + self.agreement))

    def _with_empty_memory(self, estimate: Estimate, start: np.ndarray, quiet: float) -> Estimate:
        """Return the inner adaptation's estimate with A = 0 and b = 0, quiet for a time [s].

        Its prior is the value ``start`` (p).
        """
        p = estimate.value.size
        clock = _Clock(quiet, 0.0, 1.0, 0.0, _FIRST, 0.0, 0.0)
        nothing = np.zeros((p, p)), np.zeros(p), np.zeros(p), np.zeros((0, p + 1))
        heard = np.zeros(2)
        told = _NOTHING if self.prior is None else self.prior.dot(start)
        memory = *nothing, np.zeros(self.noise.size), heard, np.array(clock), *_UNMADE, told
        return Estimate(estimate.value, (*memory, *estimate.memory))

    @staticmethod
    def _inner(estimate: Estimate) -> Estimate:
        """Return the estimate with the inner adaptation's own memory."""
        return Estimate(estimate.value, estimate.memory[_OWN:])


def _factorised(made: _Factors) -> _Factors:
    """Return the triangular factors of a matrix."""
    from scipy.linalg.lapack import dgetrf  # slow to import

    matrix, pivots, _ = dgetrf(made.matrix)
    return made._replace(matrix=matrix, pivots=pivots)


def _positive_or_infinite(value: float, name: str) -> float:
    """Return a positive number or infinity.

    Raises:
        GainError: it is neither.
    """
    if isinstance(value, float) and value == math.inf:
        return value
    return positive(value, name)


def _origin(value: np.ndarray, drive: Drive) -> np.ndarray:
    """Return W and y (n, p + 1) of a drive with a prediction error, at the value (p)."""
    assert drive.W is not None and drive.residual is not None
    return np.column_stack([drive.W, drive.W.dot(value) - drive.residual])


def _since(origin: np.ndarray, left: float, value: np.ndarray, drive: Drive) -> Drive:
    """Return the drive whose low pass started at W and y (n, p + 1), of which a share is left."""
    assert drive.W is not None and drive.residual is not None
    W_0, y_0 = origin[:, :-1], origin[:, -1]
    W, residual = drive.W - left * W_0, drive.residual - left * (W_0.dot(value) - y_0)
    return Drive(drive.Y, drive.e, W, residual, None, drive.gradient)
