"""Arrays that do not fit: public methods refuse them; of any memory layout they give the same.

What comes into a step: ``tests/controller/test_inputs.py``.
"""

import mmap
import re
import tempfile

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.adaptation import Drive, Estimate
from tests.support.chains import catalogue_robot
from tests.support.snapshots import snapshot, unchanged

EFFECTS = pa.Unknown(friction=True, armature=True)


@pytest.fixture(scope="module")
def loop():
    """Return a controller of a UR5 with rotors and friction, and the first state of a loop."""
    robot = catalogue_robot("ur5")
    controller = pa.make_controller(
        robot, law="adaptive-jacobian", adaptation="natural", unknown=EFFECTS
    )
    state = controller.init(pa.plants.PinocchioPlant(robot).measure())
    return controller, state


def methods(loop):
    """Return the name of a method -> the method, and arrays that fit it."""
    controller, state = loop
    kin, dyn, law = controller.kinematics, controller.dynamics, controller.law
    ad, a = controller.adaptation_d, state.dynamic.value
    q, v = controller.motion.robot.q0, np.full(6, 0.1)
    drive = np.full(a.size, 0.01)
    news = Drive(drive[None], np.ones(1), gradient=drive)
    return {
        "kinematics.update": (kin.update, [kin.initial, q, v]),
        "dynamics.load": (dyn.load, [a]),
        "dynamics.torque": (dyn.torque, [q, v, v]),
        "dynamics.regressor": (dyn.regressor, [q, v, v]),
        "dynamics.slotine_li": (dyn.slotine_li, [q, v, v, v]),
        "dynamics.momentum": (dyn.momentum, [q, v]),
        "posture.offset": (law.posture.offset, [q]),
        "adaptation.step": (lambda value: ad.step(Estimate(value), news, 1e-3), [a]),
        "adaptation.gain": (lambda value: ad.gain(Estimate(value)), [a]),
    }


METHODS = (
    "kinematics.update",
    "dynamics.load",
    "dynamics.torque",
    "dynamics.regressor",
    "dynamics.slotine_li",
    "dynamics.momentum",
    "posture.offset",
    "adaptation.step",
    "adaptation.gain",
)
MODELS = [name for name in METHODS if name.startswith(("kinematics", "dynamics"))]
WRONG = {"short": lambda x: x[:-1], "long": lambda x: np.append(x, 0.0), "empty": lambda x: x[:0]}


@pytest.mark.parametrize("name", MODELS)
def test_arrays_of_another_size_are_refused_by_a_model(name, loop):
    """By Pinocchio, numpy or the model itself, with the two sizes in the message."""
    method, arrays = methods(loop)[name]
    for i, array in enumerate(arrays):
        for spoil in WRONG.values():
            wrong = spoil(array)
            with pytest.raises(ValueError) as refused:
                method(*arrays[:i], wrong, *arrays[i + 1 :])
            sizes = {str(array.size), str(wrong.size)}
            assert sizes <= set(re.findall(r"\d+", str(refused.value)))


def read_only(array):
    """Return a copy in read-only memory, as joblib's memory maps are."""
    with tempfile.TemporaryFile() as file:
        file.write(np.ascontiguousarray(array).tobytes())
        file.flush()
        memory = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    return np.frombuffer(memory).reshape(array.shape)


LAYOUTS = {
    "read-only": read_only,
    "strided": lambda x: np.repeat(x, 2, axis=-1)[..., ::2],
    "Fortran": np.asfortranarray,
}


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("name", METHODS)
def test_memory_layouts_give_the_same_and_are_not_written(name, layout, loop):
    method, arrays = methods(loop)[name]
    laid, kept = [LAYOUTS[layout](x) for x in arrays], [x.copy() for x in arrays]
    expected = method(*arrays)
    found = method(*laid)
    for a, b in zip(flat(expected), flat(found), strict=True):
        assert np.allclose(a, b, rtol=1e-12, atol=1e-12)
    assert all(np.array_equal(a, b) for a, b in zip(laid, kept, strict=True))


def flat(result):
    """Return the arrays of what a method returns."""
    if result is None:
        return []
    if isinstance(result, float | int | np.ndarray):
        return [np.array(result)]
    return flat(result.value) if isinstance(result, Estimate) else list(result)


LOOPS = {
    "memory": {},
    "natural": {"adaptation": "natural"},
    "set points": {"law": "approximate-jacobian", "adaptation": "natural"},
}


@pytest.mark.parametrize("options", LOOPS.values(), ids=LOOPS)
def test_arrays_of_the_caller_are_neither_kept_nor_shared(options):
    robot = pa.load("planar_2r")
    controller, plant = pa.make_controller(robot, **options), pa.plants.PinocchioPlant(robot)
    first = plant.measure()
    state = controller.init(first)
    for k in range(1, 4):
        sample = plant.measurement(robot.q0 + 1e-3 * k, np.full(2, 0.1), 1e-3 * k)
        desired = pa.Desired(first.x.copy(), np.zeros(2), np.zeros(2))
        torque, state = controller.step(state, sample, desired, 1e-3)
        before = snapshot(state)
        for array in (torque, sample.q, sample.v, sample.x, *desired):
            array += 9.0
        assert unchanged(state, before)
    for part, value in (("x_d", np.inf), ("x_d", np.nan), ("xd_d", -np.inf), ("xdd_d", np.inf)):
        wrong = pa.Desired(first.x, *np.zeros((2, 2)))._replace(**{part: np.full(2, value)})
        with pytest.raises(pa.InputError, match="not finite"), np.errstate(all="ignore"):
            controller.step(state, plant.measurement(robot.q0, np.zeros(2), 0.004), wrong, 1e-3)
        with pytest.raises(pa.InputError, match="not finite"):
            controller.observe(state, plant.measurement(robot.q0, np.zeros(2), 0.004), wrong)
