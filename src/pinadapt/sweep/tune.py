"""Gains by search over a distribution of cases, compared with the defaults on unseen ones."""

from __future__ import annotations

import math
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from .._checks import LARGEST, optional, positive, whole
from .._output import Record, Report, Table, percent
from ..exceptions import InputError
from ..simulation.simulate import watched
from .cases import Plan, Values
from .execution import rows
from .sweep_report import Rate, SweepReport, percentile, rate, succeeded
from .table import CaseTable, Row


@dataclass(frozen=True)
class Judged:
    """Results of all cases with one set of gains.

    Attributes:
        gains: by key; empty: the defaults.
        objective: percentile of the result; above 1e6 where lost cases reach it.
        errors: the result of each case (N), infinite for lost ones.
        success: share of the cases that ran to their end with a verdict "follows".
    """

    gains: Row
    objective: float
    errors: np.ndarray
    success: Rate


@dataclass(frozen=True)
class Tuned:
    """What a search found; ``print`` shows it.

    Attributes:
        numbers: as ``tune.json`` has them: ``verdict``, whether the gains found are ``better``,
            ``objective`` in words, ``gains`` by key, the objective of the defaults and of the best
            gains on the cases of the ``search`` and on those of the ``validation``, which have
            another seed, their ``success`` there, the number of ``cases`` and all ``trials``.
    """

    numbers: Row

    def __str__(self) -> str:
        """Return gains, objectives and verdict as text."""
        numbers = self.numbers
        rows = [
            [
                words,
                *(_amount(numbers[on][of]) for on in ("search", "validation")),
                Rate(**numbers["success"][of]),
            ]
            for of, words in {"default": "defaults", "best": "found"}.items()
        ]
        header = ["gains", "in the search", "on other seeds", "success on other seeds"]
        chosen = [(key, f"{value}") for key, value in numbers["gains"].items()]
        tables = Table(rows, header), Table(chosen)
        return str(Report(numbers["objective"], tables, numbers["verdict"]))


def tune(
    work: Plan | Path | str,
    gains: Record,
    *,
    samples: int | None = None,
    trials: int = 40,
    objective: str = "error_share",
    share: float = 0.9,
    validation: int | None = None,
    executor: Executor | int | None = None,
) -> Tuned:
    """Search gains, validate them on other seeds, and say whether the defaults are as good.

    Args:
        work: a sweep or its file: the cases over which gains are judged. Each trial runs all of
            them.
        gains: what is searched, by key: "loguniform(5, 100)", "uniform(a, b)", or a list of
            choices.
        samples: number of samples of the distributions.
        trials: number of gains that are tried.
        objective: the result whose percentile is minimised.
        share: which percentile (default: 0.9); failed cases count as the worst.
        validation: number of samples with another seed, on which gains are compared; None: as in
            the search.
        executor: as ``sweep`` has it.

    Raises:
        InputError: a range cannot be used, a key is varied as well, the cases have no such result,
            or Optuna is not installed.
    """
    plan = work if isinstance(work, Plan) else Plan.read(Path(work), samples=samples)
    found = searched(gains, plan)
    positive(share, "share", most=1.0, error=InputError)
    trials = whole(trials, "trials", 1)
    more: Row = {}
    if validation is not None:
        more["samples" if plan.samples else "repeat"] = validation
    other = replace(plan, seed=plan.seed + 1, **more)
    if len(other.cases) < 5:  # 1 / 2^n, the least p of Wilcoxon's test, is below 1 / 20 from here
        raise InputError(
            f"{len(other.cases)} cases do not tell better gains from chance; five do.",
            where="validation",
            hint="Take more samples, or --validation N.",
        )

    def judge(chosen: Row, plan: Plan) -> Judged:
        """Return how the cases end with these gains."""
        changed = (replace(case, values=case.values | chosen) for case in plan.cases)
        table = CaseTable(rows(plan, changed, executor))
        errors = np.full(len(table), np.inf)
        if not table.lost.all():
            errors = SweepReport(table, plan).values(objective)
        value = percentile(errors, share).value
        if not math.isfinite(value):
            value = LARGEST * (1.0 + float(np.mean(np.isinf(errors))))
        return Judged(chosen, value, errors, rate(succeeded(table)))

    optuna = optional("optuna", "tune", "tune")
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    study = optuna.create_study(sampler=optuna.samplers.TPESampler(seed=plan.seed))
    spaces = {
        key: optuna.distributions.CategoricalDistribution(values.arguments)
        if values.kind == "choice"
        else optuna.distributions.FloatDistribution(
            *map(float, values.arguments), log=values.kind == "loguniform"
        )
        for key, values in found.items()
    }
    before = judge({}, plan)
    tried = []
    for _ in watched(range(trials), None, "tune"):
        trial = study.ask(spaces)
        tried.append(judge(trial.params, plan))
        study.tell(trial, tried[-1].objective)
    best = min(tried, key=lambda each: each.objective)
    default = judge({}, other)
    chosen = judge(best.gains, other)
    words, better = verdict(default, chosen)
    return Tuned(
        {
            "verdict": words,
            "better": better,
            "objective": f"{share:.0%} percentile of {objective}",
            "cases": {"search": len(best.errors), "validation": len(chosen.errors)},
            "gains": best.gains,
            "search": {"default": before.objective, "best": best.objective},
            "validation": {"default": default.objective, "best": chosen.objective},
            "success": {"default": default.success._asdict(), "best": chosen.success._asdict()},
            "trials": [{"gains": each.gains, "objective": each.objective} for each in tried],
        }
    )


def searched(gains: Record, plan: Plan) -> dict[str, Values]:
    """Return what is searched, by key.

    Raises:
        InputError: a range cannot be used, or a key is varied by the sweep as well.
    """
    found = {}
    if not gains:
        raise InputError("nothing to search.", where="gains", hint='{"controller.beta": ...}.')
    for key, value in gains.items():
        values = Values.of(key, value)
        if not values.drawn:
            values = replace(values, kind="choice")
        varied = any(key in case.values for case in plan.cases)
        if values.shape or values.kind == "normal" or varied:
            raise InputError(
                "give one uniform, loguniform or choice, of what the sweep does not vary.",
                where=key,
            )
        plan.check({key: values.at(np.array([0.5]))})
        found[key] = values
    return found


def verdict(default: Judged, best: Judged) -> tuple[str, bool]:
    """Return whether the gains found are better than the defaults on the same unseen cases.

    They are if fewer cases are lost, or as many, the objective falls by a tenth, and Wilcoxon's
    signed-rank test (1945) says that chance would do as well in less than one of twenty.
    """
    from scipy.stats import wilcoxon

    both = np.isfinite(default.errors) & np.isfinite(best.errors)
    change = best.errors[both] - default.errors[both]
    p = wilcoxon(change, alternative="less").pvalue if change.any() else 1.0
    lost = np.isinf(best.errors).sum() - np.isinf(default.errors).sum()
    words = (
        f"on other seeds the objective is {_amount(best.objective)} with the gains found and "
        f"{_amount(default.objective)} with the defaults"
    )
    if lost > 0:
        return f"The defaults are better: {words}, and {lost} more cases are lost.", False
    if lost < 0 and best.objective < default.objective:
        return f"The gains found are better: {words} ({-lost} cases fewer are lost).", True
    better = bool(best.objective < 0.9 * default.objective and p < 0.05)
    outcome = "gains found are better" if better else "defaults are as good"
    return f"The {outcome}: {words} (chance alone: {percent(p)}).", better


def _amount(value: float) -> str:
    return "lost" if value >= LARGEST else f"{value:.3g}"
