"""figaroh: base parameters by least squares, or all parameters in the physical cone.

It is not among the packages of the project: ``pip install figaroh``. Measured with 1.0.2.
"""

from __future__ import annotations

import json
from contextlib import redirect_stdout
from importlib import import_module
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time
from typing import Any

import numpy as np

from pinadapt.models.regressor import LABELS

from .estimation import Estimates, LearningProblem

_COEFFICIENTS = {"Ia": "armature", "fv": "viscous", "fs": "coulomb", "off": "offset"}
_SLOWEST = 15.0  # [Hz] samples that decimation leaves, twice the band of a window


def figaroh_fit(problem: LearningProblem, stage: str = "fit") -> Estimates:
    """Return what figaroh identifies.

    Its defaults, but: q, v and a are filtered already, least squares are weighted by joint, and the
    decimation by ten is less where it would leave fewer than 15 samples a second.

    Args:
        problem: the motion and the model.
        stage: "fit": base parameters, the others as described; "physical_fit": its semidefinite
            program over all bodies.

    Raises:
        ValueError: the program has no accepted solution.
    """
    base_class: Any = import_module("figaroh.identification").BaseIdentification
    motion = problem.learned
    names = problem.robot.joint_names

    class Identification(base_class):
        """The motion of the problem, already filtered."""

        def load_param(self, *args: Any, **options: Any) -> None:
            super().load_param(*args, **options)
            joints = [self.model.joints[self.model.getJointId(name)] for name in names]
            self.identif_config["act_idxq"] = [joint.idx_q for joint in joints]
            self.identif_config["act_idxv"] = [joint.idx_v for joint in joints]

        def load_trajectory_data(self, data_source: str | None = None) -> dict[str, np.ndarray]:
            return {
                "timestamps": motion.t,
                "positions": motion.q,
                "velocities": motion.v,
                "accelerations": motion.a,
                "torques": motion.tau,
            }

        def process_kinematics_data(self, filter_config: Any = None) -> None:
            self.processed_data = {**self.raw_data}

    config = {
        "_metadata": {"schema_version": "2.0"},
        "robot": {
            "name": problem.robot.name,
            "properties": {
                "joints": {"active_joints": names},
                "coupling": {"has_coupled_wrist": False},
            },
        },
        "tasks": {
            "identification": {
                "type": "identification",
                "problem": {},
                "signal_processing": {
                    "sampling_frequency": 1.0 / motion.period,
                    "cutoff_frequency": 0.4 / motion.period,
                },
                "select_stage": stage,
            }
        },
    }
    factor = max(min(10, int(1.0 / motion.period / _SLOWEST)), 1)
    with TemporaryDirectory() as folder, redirect_stdout(StringIO()):
        urdf = Path(folder) / "robot.urdf"
        settings = Path(folder) / "config.yaml"
        urdf.write_text(problem.robot.urdf(shapes=False))
        settings.write_text(json.dumps(config))  # JSON is YAML
        robot = import_module("figaroh.tools.robot").Robot(str(urdf), folder)
        chain = problem.robot.model
        # locked joints are no part of the chain
        robot.model = chain.copy()
        robot.data = chain.createData()
        robot.q0 = problem.robot.q0
        robot.v0 = np.zeros(chain.nv)
        started = process_time()
        found = Identification(robot, str(settings))
        found.initialize()
        found.solve(decimate=factor > 1, decimation_factor=factor, plotting=False, wls=True)
        seconds = process_time() - started
    words = list(found.standard_parameter)
    if stage == "fit":
        a = problem.dynamics.initial.copy()
        kept = np.delete(np.arange(len(words)), found._idx_eliminated)[found._base_indices]
        base = [problem.dynamics.names.index(_name(words[k])) for k in kept]
        W = problem.first.W / problem.noise[:, None]
        # the same torques with the other parameters as described
        zero = W[:, :, base] @ np.asarray(found.phi_base).ravel()
        change = zero - W @ a
        A = W[:, :, base].reshape(-1, len(base))
        a[base] += np.linalg.lstsq(A, change.ravel(), rcond=1e-12)[0]
    else:
        selected = found.selected
        if not selected.accepted:
            raise ValueError(f"figaroh: {selected.reason}")
        values = dict(zip(map(_name, words), selected.values, strict=True))
        a = np.array([values[name] for name in problem.dynamics.names])
    return Estimates(motion.t[-1:], a[None], seconds)


def _name(word: str) -> str:
    """Return our name of a parameter of figaroh."""
    kind, _, joint = word.partition("_")
    label = _COEFFICIENTS.get(kind)
    if label is None:
        label = next(own for own in LABELS if own.replace("c", "") == kind)
    return f"{joint}.{label}"
