"""``pinadapt tune``: gains by search over a distribution of cases, compared with the defaults."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from .._output import Sheet, Table, check_writable, percent, write_text
from ..exceptions import InputError
from ..simulation.simulate import watched
from ..sweep.cases import Cases, Plan, Values, parsed_setting
from ..sweep.execution import engine, rows, work_of
from ..sweep.sweep_report import Rate, percentile, rate
from ..sweep.table import DONE, CaseTable
from .command_line import DONE as STATUS
from .command_line import add_out, add_scenario, positive

FILE = "tune.json"
_OTHER_SEED = 1  # added to the sweep's seed for the validation
_PENALTY = 1e6  # objective where lost cases reach the percentile, times 1 + their share
_BETTER, _CHANCE = 0.9, 0.05  # ratio of objectives, and probability, below which gains are better


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add_scenario(parser)
    parser.epilog = (
        "The file is a sweep file, or a scenario with --vary: the cases over which gains are "
        "judged. Each trial runs all of them."
    )
    parser.add_argument(
        "--gain",
        nargs="+",
        action="extend",
        default=[],
        metavar="KEY=RANGE",
        help="what is searched: controller.alpha=loguniform(5, 100), uniform(a, b), choice([...])",
    )
    parser.add_argument("--vary", nargs="+", action="extend", default=[], metavar="KEY=VALUES")
    parser.add_argument(
        "--samples", type=positive, metavar="N", help="number of samples of the distributions"
    )
    parser.add_argument(
        "--trials", type=positive, default=40, metavar="N", help="default: %(default)s"
    )
    parser.add_argument(
        "--objective",
        default="error_share",
        metavar="COLUMN",
        help="the result whose percentile is minimised (default: %(default)s)",
    )
    parser.add_argument(
        "--percentile",
        type=float,
        default=0.9,
        metavar="P",
        help=(
            "percentile of the objective over the cases; failed cases count as the worst "
            "(default: %(default)s)"
        ),
    )
    parser.add_argument(
        "--validation",
        type=positive,
        metavar="N",
        help="samples with other seeds, on which gains are compared (default: as in the search)",
    )
    parser.add_argument(
        "--processes", type=int, metavar="N", help="number of processes (default: one per core)"
    )
    parser.add_argument(
        "--scheduler", metavar="ADDRESS", help="Dask scheduler to run on, or 'local'"
    )
    add_out(parser, "out/ and the file's name and -tune")


@dataclass(frozen=True)
class Judged:
    """Results of all cases with one set of gains.

    Attributes:
        gains: by key; empty: the defaults.
        objective: percentile of the result; above ``_PENALTY`` where lost cases reach it.
        errors: the result of each case (N), infinite for lost ones.
        success: share of the cases that ran to their end with a verdict "follows".
    """

    gains: dict[str, Any]
    objective: float
    errors: np.ndarray
    success: Rate


@dataclass(frozen=True)
class Judge:
    """Runs the cases of a sweep with some gains.

    Attributes:
        plan: the sweep.
        engine: that runs it.
        column: the result.
        p: its percentile that is the objective.
    """

    plan: Plan
    engine: Executor
    column: str
    p: float

    def __call__(self, gains: Mapping[str, Any], cases: Cases) -> Judged:
        """Return how the cases end with these gains.

        Raises:
            InputError: the cases have no such result.
        """
        changed = (replace(case, values=case.values | dict(gains)) for case in cases)
        table = CaseTable.of(list(rows(work_of(self.plan), changed, self.engine)))
        lost = table["status"] != DONE
        found = np.full(len(table), np.nan) if lost.all() else table[self.column].astype(float)
        errors = np.where(lost | np.isnan(found), np.inf, found)
        value = percentile(errors, self.p).value
        if not math.isfinite(value):
            value = _PENALTY * (1.0 + float(np.mean(np.isinf(errors))))
        follows = table["follows"] if "follows" in table.columns else ~lost
        return Judged(dict(gains), value, errors, rate((follows == 1) & ~lost))


def tune(options: argparse.Namespace) -> int:
    """Search gains, validate them on other seeds, and say whether the defaults are as good.

    Writes ``tune.json`` with all trials.
    """
    plan = Plan.read(options.scenario, options.vary, options.set, samples=options.samples)
    gains = searched(options.gain, plan)
    if not 0.0 < options.percentile <= 1.0:
        raise InputError(
            f"a share above 0 and at most 1 is expected, got {options.percentile:g}.",
            where="--percentile",
        )
    more: dict[str, Any] = {}
    if options.validation is not None:
        more["samples" if plan.cases.samples else "repeat"] = options.validation
    folder = options.out or Path("out") / f"{options.scenario.stem}-tune"
    check_writable(folder, [FILE])
    suggest, tell = _optuna(gains, plan.cases.seed)
    with engine(options.processes, options.scheduler, plan.timeout) as workers:
        judge = Judge(plan, workers, options.objective, options.percentile)
        default = judge({}, plan.cases)
        trials = []
        for _ in watched(range(options.trials), None, "tune"):
            trial, chosen = suggest()
            trials.append(judge(chosen, plan.cases))
            tell(trial, trials[-1].objective)
        best = min(trials, key=lambda each: each.objective)
        other = replace(plan.cases, seed=plan.cases.seed + _OTHER_SEED, **more)
        checked = judge({}, other), judge(best.gains, other)
    words, better = verdict(*checked)
    found = {
        "verdict": words,
        "better": better,
        "objective": f"{options.percentile:.0%} percentile of {options.objective}",
        "cases": {"search": len(plan.cases), "validation": len(other)},
        "gains": best.gains,
        "search": {"default": default.objective, "best": best.objective},
        "validation": {"default": checked[0].objective, "best": checked[1].objective},
        "success": {"default": checked[0].success._asdict(), "best": checked[1].success._asdict()},
        "trials": [{"gains": each.gains, "objective": each.objective} for each in trials],
    }
    write_text(folder / FILE, json.dumps(found, indent=2) + "\n")
    print(_sheet(str(found["objective"]), default, best, *checked))
    if better:
        print("\n--set " + " ".join(f"{key}={value}" for key, value in best.gains.items()))
    print(f"\nwritten to {folder}\n\n{words}")
    return STATUS


def searched(given: list[str], plan: Plan) -> dict[str, Values]:
    """Return what is searched, by key.

    Raises:
        InputError: nothing is, a range cannot be used, or a key is varied by the sweep as well.
    """
    if not given:
        raise InputError(
            "no gain is searched.",
            where="--gain",
            hint="Name some: --gain 'controller.alpha=loguniform(5, 100)'.",
        )
    found = {}
    for text in given:
        key, value = parsed_setting(text, "--gain")
        values = Values.of(key, value)
        if not values.drawn:
            values = replace(values, kind="choice")
        if values.size is not None or values.kind == "normal":
            raise InputError("give one uniform, loguniform or choice.", where=key)
        if key in plan.cases.keys:
            raise InputError("is varied by the sweep already.", where=key)
        if plan.scenario is not None:
            middle = {key: values.at(np.array([0.5]))}
            Plan.of(plan.tables() | {"set": middle})
        found[key] = values
    return found


def _optuna(
    gains: Mapping[str, Values], seed: int
) -> tuple[Callable[[], tuple[Any, dict[str, Any]]], Callable[[Any, float], None]]:
    """Return two functions: one suggests gains, the other takes their objective."""
    try:
        import optuna
    except ImportError as error:
        raise InputError(
            "Optuna, which searches, is not installed.",
            where="tune",
            hint="Install it: pip install 'pinadapt[tune]'.",
        ) from error
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    study = optuna.create_study(sampler=optuna.samplers.TPESampler(seed=seed))

    def suggest() -> tuple[Any, dict[str, Any]]:
        """Return a trial and its gains."""
        trial, chosen = study.ask(), {}
        for key, values in gains.items():
            if values.kind == "choice":
                chosen[key] = trial.suggest_categorical(key, values.arguments)
            else:
                log = values.kind == "loguniform"
                chosen[key] = trial.suggest_float(key, *values.arguments, log=log)
        return trial, chosen

    def tell(trial: Any, objective: float) -> None:
        """Tell the objective of a trial."""
        study.tell(trial, objective)

    return suggest, tell


def verdict(default: Judged, best: Judged) -> tuple[str, bool]:
    """Return whether the gains found are better than the defaults on the same unseen cases.

    They are if the objective falls by a tenth and Wilcoxon's test of the cases' ratios (1945)
    says that chance would do as well in less than one of twenty.
    """
    from scipy.stats import wilcoxon

    both = np.isfinite(default.errors) & np.isfinite(best.errors)
    logs = np.log(np.maximum(best.errors[both], 1e-300) / np.maximum(default.errors[both], 1e-300))
    lost = int(np.isinf(best.errors).sum() - np.isinf(default.errors).sum())
    p = float(wilcoxon(logs, alternative="less").pvalue) if len(logs) and logs.any() else 1.0
    ratio = best.objective / default.objective
    words = (
        f"on other seeds the objective is {_amount(best.objective)} with the gains found and "
        f"{_amount(default.objective)} with the defaults"
    )
    if lost > 0:
        return f"The defaults are better: {words}, and {lost} more cases are lost.", False
    fewer = lost < 0 and best.objective < default.objective
    if fewer or (ratio < _BETTER and p < _CHANCE):
        chance = f"a chance of {percent(p, 1)}" if not fewer else f"{-lost} cases fewer are lost"
        return f"The gains found are better: {words} ({chance}).", True
    return f"The defaults are as good: {words} (chance alone: {percent(p, 2)}).", False


def _amount(value: float) -> str:
    return "lost" if value >= _PENALTY else f"{value:.3g}"


def _sheet(
    objective: str, default: Judged, best: Judged, default_other: Judged, best_other: Judged
) -> str:
    """Return gains and objectives as text."""
    rows_ = [
        ["defaults", _amount(default.objective), _amount(default_other.objective)],
        ["found", _amount(best.objective), _amount(best_other.objective)],
    ]
    successes = (default_other.success, best_other.success)
    table = Table(
        [[*row, str(success)] for row, success in zip(rows_, successes, strict=True)],
        ["gains", "in the search", "on other seeds", "success on other seeds"],
    )
    chosen = Table(
        [
            (key, f"{value:.4g}" if isinstance(value, float) else str(value))
            for key, value in best.gains.items()
        ]
    )
    return str(Sheet(objective, [table, chosen]))
