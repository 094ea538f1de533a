"""MuJoCo's system identification, ``mujoco.sysid``, of bodies and joints from torques.

It needs ``pip install "mujoco[sysid]"``. Measured with 3.17.0.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import redirect_stdout
from importlib import import_module
from io import StringIO
from time import process_time
from typing import Any

import numpy as np

from pinadapt.models.bodies import COLUMNS

from .estimation import Estimates, LearningProblem

_OFFSET = "offset"
_PER_WINDOW = 4  # means of samples in a window, whose band is 1.3 over its length
_MOST = 1000.0  # typical coefficients of a joint that its bounds allow; a TX40 has 618
_JOINTS = {"armature": "armature", "viscous": "damping", "coulomb": "frictionloss"}


def mujoco_sysid(problem: LearningProblem) -> Estimates:
    """Return what ``mujoco.sysid.optimize`` finds, with its defaults.

    Parameters are the pseudo-inertias of all bodies, within the default bounds, and armature,
    damping and friction loss of the joints and an offset of their torque sensors. The model cannot
    be rolled out along tens of seconds of recorded torques, in which it would fall, so the
    prediction is by ``mj_inverse``: torques at the measured q, v and a, four means a window.

    Args:
        problem: the motion and the model.

    Raises:
        ModuleNotFoundError: it is not installed.
    """
    mujoco: Any = import_module("mujoco")
    sysid: Any = import_module("mujoco.sysid")
    if not hasattr(sysid, "optimize"):
        raise ModuleNotFoundError("mujoco[sysid]")
    dynamics = problem.dynamics
    motion = problem.learned
    thin = max(int(problem.windows.length / (_PER_WINDOW * motion.period)), 1)
    t, q, v, a, tau = (
        part[: len(part) // thin * thin].reshape(-1, thin, *part.shape[1:]).mean(axis=1)
        for part in motion[:-1]
    )
    names = problem.robot.joint_names
    physical = problem.physical
    robot = dynamics.robot(physical.center, problem.robot)
    spec = mujoco.MjSpec.from_string(robot.mjcf())
    spec.compiler.balanceinertia = spec.compiler.boundmass = 0
    for name in names:
        joint = spec.joint(name)
        joint.limited = mujoco.mjtLimited.mjLIMITED_FALSE
        spec.add_sensor(
            name=f"{name}_torque",
            type=mujoco.mjtSensor.mjSENS_JOINTACTFRC,
            objtype=mujoco.mjtObj.mjOBJ_JOINT,
            objname=name,
        )
    model = spec.compile()
    carriers = [spec.joint(name).parent.name for name in names]
    parameters = sysid.ParameterDict()
    for carrier in carriers:
        options = {"inertia_type": sysid.InertiaType.Pseudo, "modifier": _body_writer(carrier)}
        parameters.add(sysid.body_inertia_param(spec, model, carrier, **options))
    typical = dict(zip(dynamics.names, dynamics.typical, strict=True))
    start = dict(zip(dynamics.names, dynamics.initial, strict=True))
    for name in names:
        for ours, theirs in _JOINTS.items():
            word = f"{name}.{ours}"
            most = _MOST * typical[word]
            write_one = _writer(name, theirs)
            parameters.add(sysid.Parameter(word, start[word], 0.0, most, modifier=write_one))
    most = _MOST * np.array([typical[f"{name}.{_OFFSET}"] for name in names])
    parameters.add(sysid.Parameter(_OFFSET, np.zeros(len(names)), -most, most))
    sequence = sysid.ModelSequences(
        "robot",
        spec,
        "log",
        sysid.create_initial_state(model, q[0], v[0]),
        sysid.TimeSeries.from_control_names(t, tau, model),
        sysid.TimeSeries.from_names(t, tau, model),
    )

    def predicted(
        models: Sequence[Any],
        datas: Sequence[Any],
        control_signal: Sequence[Any],
        initial_states: Sequence[np.ndarray],
        param_dicts: Sequence[Any],
        **mappings: Any,
    ) -> list[Any]:
        """Return the torques at all samples but the first, as of a rollout."""
        data = datas[0]
        found = []
        state = sysid.TimeSeries(
            t[1:], np.column_stack([t, q, v])[1:], mappings["rollout_state_mapping"]
        )
        for one, values, control in zip(models, param_dicts, control_signal, strict=True):
            mujoco.mj_resetData(one, data)
            torque = np.empty((len(t) - 1, len(names)))
            for k in range(1, len(t)):
                data.qpos[:], data.qvel[:], data.qacc[:] = q[k], v[k], a[k]
                mujoco.mj_inverse(one, data)
                torque[k - 1] = data.qfrc_inverse
            torque += values[_OFFSET].value
            sensed = sysid.TimeSeries(t[1:], torque, mappings["rollout_signal_mapping"])
            found.append(sysid.SystemTrajectory(one, control, sensed, initial_states[0], state))
        return found

    residual = sysid.build_residual_fn(
        models_sequences=[sequence], custom_rollout=predicted, resample_true=False
    )
    started = process_time()
    with redirect_stdout(StringIO()):
        found, _ = sysid.optimize(parameters, residual, verbose=False)
    seconds = process_time() - started
    inverse = np.linalg.pinv(COLUMNS)
    parts = list[float]()
    for carrier in carriers:
        theta = found[f"{carrier}_inertia"].value
        J = sysid.model_modifier.pseudoinertia_from_pi(sysid.model_modifier.pi_from_theta(theta))
        parts += list(J.ravel() @ inverse)
    for word in dynamics.names[len(parts) :]:
        name, _, kind = word.rpartition(".")
        values = found[_OFFSET].value[names.index(name)] if kind == _OFFSET else found[word].value
        parts.append(float(np.squeeze(values)))
    return Estimates(t[-1:], np.array(parts)[None], seconds)


def _body_writer(name: str) -> Callable[[Any, Any], None]:
    """Return the modifier of a body; that of 3.17.0 writes a quaternion that does not compile."""
    model_modifier: Any = import_module("mujoco.sysid").model_modifier

    def write(spec: Any, parameter: Any) -> None:
        pi = model_modifier.pi_from_theta(parameter.value)
        body = spec.body(name)
        cross = model_modifier.skew(pi[1:4] / pi[0])
        inertia = pi[4:].reshape(3, 3) + pi[0] * cross @ cross
        body.mass = pi[0]
        body.ipos = pi[1:4] / pi[0]
        body.iquat = [1.0, 0.0, 0.0, 0.0]
        body.inertia = np.zeros(3)
        body.fullinertia = inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]

    return write


def _writer(joint: str, attribute: str) -> Callable[[Any, Any], None]:
    """Return the modifier of an attribute of a joint."""

    def write(spec: Any, parameter: Any) -> None:
        held = getattr(spec.joint(joint), attribute)  # damping is a polynomial, viscous first
        value = parameter.value[0] * np.eye(1, np.size(held)).reshape(np.shape(held))
        setattr(spec.joint(joint), attribute, value if np.ndim(held) else float(value))

    return write
