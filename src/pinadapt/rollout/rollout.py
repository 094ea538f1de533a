"""What a run leaves behind."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .._version import __version__
from ..tasks.registry import task_named
from .table import number, two_columns


@dataclass(frozen=True, eq=False)
class Rollout:
    """A closed loop over N samples; ``print`` shows a table. All in SI units, positions in world axes.

    Attributes: title, robot, law, adaptation, task: what ran. kinematic_names, dynamic_names: one
        name a parameter. kinematic_base: how many combinations of the kinematic parameters motion
        can identify. t: (N) time [s]. q, v, tau: (N, nq), (N, nv), (N, nv) true configuration and
        velocity, torque given by the motors. x, x_d, error: (N, m) true and desired task position,
        and their difference [m]; for a pose (N, 7), (N, 7) and (N, 6), position [m] before
        quaternion xyzw or rotation vector [rad]. a_k, a_d: (N, p_k), (N, p_d) estimates. a_k_true,
        a_d_true: the true parameters, or None where no value of the parameters is the truth.
        lyapunov: (N) V(t), or None where undefined. min_eig_M_hat: (N) smallest eigenvalue of the
        estimated mass matrix. min_singular_J_hat: (N) smallest singular value of the estimated
        Jacobian. damping: (N) mu^2 of its right inverse, zero where that is exact; see
        ``laws.right_inverse``. damping_share: (N) mu^2 / (s_min^2 + mu^2), the largest share of a
        commanded task motion that the damping takes away. saturated: (N) whether a torque was at
        its limit. diverged: time [s] at which the loop left every bound, or None; the arrays end
        there. reason: why it diverged, or None. wall_time: seconds for the whole run. step_time:
        mean seconds of one controller step; zero in continuous mode, which has no steps.
    """

    title: str
    robot: str
    law: str
    adaptation: str
    task: str
    kinematic_names: tuple[str, ...]
    dynamic_names: tuple[str, ...]
    kinematic_base: int
    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    tau: np.ndarray
    x: np.ndarray
    x_d: np.ndarray
    error: np.ndarray
    a_k: np.ndarray
    a_d: np.ndarray
    a_k_true: np.ndarray | None
    a_d_true: np.ndarray | None
    lyapunov: np.ndarray | None
    min_eig_M_hat: np.ndarray
    min_singular_J_hat: np.ndarray
    damping: np.ndarray
    damping_share: np.ndarray
    saturated: np.ndarray
    diverged: float | None
    reason: str | None
    wall_time: float
    step_time: float

    @property
    def distance(self) -> np.ndarray:
        """Norm of the position error (N) [m]."""
        return np.linalg.norm(self.error[:, : task_named(self.task).positions], axis=1)

    @property
    def angle(self) -> np.ndarray | None:
        """Angle between true and desired orientation (N) [rad], or None for tasks without one."""
        turning = self.error[:, task_named(self.task).positions :]
        return np.linalg.norm(turning, axis=1) if turning.shape[1] else None

    def window(self, first: bool) -> np.ndarray:
        """Return the position error norms (>= 1) [m] in the first or last 10 % of the samples."""
        return self._window(self.distance, first)

    def _window(self, values: np.ndarray, first: bool) -> np.ndarray:
        count = max(1, len(self.t) // 10)
        return values[:count] if first else values[-count:]

    def _angles(self) -> dict[str, float | None]:
        """Return what the summary says of the orientation [rad], nothing for tasks without one."""
        if self.angle is None:
            return {}
        return {
            "max_angle_first": _extreme(np.max, self._window(self.angle, True)),
            "max_angle_last": _extreme(np.max, self._window(self.angle, False)),
            "rms_angle_last": _extreme(_rms, self._window(self.angle, False)),
        }

    def summary(self) -> dict[str, Any]:
        """Return the numbers of ``summary.json``; None stands for those that no sample or no finite number gives."""
        return {
            "title": self.title,
            "law": self.law,
            "adaptation": self.adaptation,
            "task": self.task,
            "robot": self.robot,
            "nv": int(self.v.shape[1]),
            "diverged": self.diverged,
            "reason": self.reason,
            "max_error_first": _extreme(np.max, self.window(True)),
            "max_error_last": _extreme(np.max, self.window(False)),
            "rms_error_last": _extreme(_rms, self.window(False)),
            **self._angles(),
            "tau_max": _extreme(np.max, np.abs(self.tau)),
            "min_eig_M_hat": _extreme(np.min, self.min_eig_M_hat),
            "min_singular_J_hat": _extreme(np.min, self.min_singular_J_hat),
            "max_damping": _extreme(np.max, self.damping),
            "max_damping_share": _extreme(np.max, self.damping_share),
            "saturated": _extreme(np.mean, self.saturated),
            "steps": len(self.t),
            "wall_time_s": self.wall_time,
            "step_time_us": self.step_time * 1e6,
            "kinematic_names": list(self.kinematic_names),
            "dynamic_names": list(self.dynamic_names),
            "kinematic_base": self.kinematic_base,
            "version": __version__,
        }

    def __str__(self) -> str:
        """Return a table of what matters."""
        numbers = self.summary()

        rows = [
            ("robot", f"{self.robot}, {numbers['nv']} joints"),
            ("law", self.law),
            (
                "adaptation",
                f"{self.adaptation}: {len(self.kinematic_names)} kinematic, {len(self.dynamic_names)} dynamic",
            ),
            ("error, first 10 % (max)", number(numbers["max_error_first"], "mm", scale=1e3)),
            ("error, last 10 % (max)", number(numbers["max_error_last"], "mm", scale=1e3)),
            ("error, last 10 % (rms)", number(numbers["rms_error_last"], "mm", scale=1e3)),
            *self._angle_rows(numbers),
            ("largest torque", number(numbers["tau_max"], "N m", digits=1)),
            ("smallest eigenvalue of M_hat", number(numbers["min_eig_M_hat"], "kg m^2", digits=5)),
            (
                "smallest singular value of J_hat",
                number(numbers["min_singular_J_hat"], "m" if self.angle is None else "", digits=4),
            ),
            ("V, first and last", self._lyapunov_words()),
            ("samples", f"{numbers['steps']} in {self.wall_time:.1f} s"),
        ]
        if numbers["max_damping"]:
            share, lost = np.mean(self.damping > 0.0), numbers["max_damping_share"]
            rows.append(
                (
                    "damped near a singularity",
                    f"{share:.1%} of the time, up to {lost:.0%} of the task motion lost",
                )
            )
        if numbers["saturated"]:
            rows.append(("torque at its limit", f"{numbers['saturated']:.1%} of the time"))
        if self.step_time:
            rows.append(("controller step (mean)", number(numbers["step_time_us"], "us", digits=0)))
        if self.diverged is not None:
            rows.append(("DIVERGED", f"at {self.diverged:.3f} s: {self.reason}"))
        return two_columns(self.title, rows)

    def _angle_rows(self, numbers: dict[str, Any]) -> list[tuple[str, str]]:
        rows = {
            "max_angle_first": "angle, first 10 % (max)",
            "max_angle_last": "angle, last 10 % (max)",
        }
        return [
            (words, number(numbers[key], "deg", scale=180.0 / np.pi))
            for key, words in rows.items()
            if key in numbers
        ]

    def _lyapunov_words(self) -> str:
        if self.lyapunov is None or not len(self.lyapunov):
            return "undefined"
        return f"{self.lyapunov[0]:.4g} -> {self.lyapunov[-1]:.4g}"

    def save(self, folder: Path | str) -> None:
        """Write ``summary.json`` and ``rollout.npz`` into a folder, which is made if it is missing."""
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "summary.json").write_text(
            json.dumps(self.summary(), indent=2) + "\n", encoding="utf-8"
        )
        names = [
            "t",
            "q",
            "v",
            "tau",
            "x",
            "x_d",
            "error",
            "a_k",
            "a_d",
            "a_k_true",
            "a_d_true",
            "lyapunov",
        ]
        names += ["min_eig_M_hat", "min_singular_J_hat", "damping", "damping_share", "saturated"]
        arrays = {name: getattr(self, name) for name in names}
        np.savez_compressed(
            folder / "rollout.npz", **{name: a for name, a in arrays.items() if a is not None}
        )

    def plot(self, folder: Path | str) -> list[Path]:
        """Draw ``error.png``, ``parameters.png`` and ``torque.png`` into a folder and return their paths."""
        from ..plots.figures import draw_all

        return draw_all(self, Path(folder))


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _extreme(of: Callable[[np.ndarray], float], values: np.ndarray) -> float | None:
    """Return a number made of the finite values, or None where there is none."""
    finite = values[np.isfinite(values)]
    return float(of(finite)) if finite.size else None
