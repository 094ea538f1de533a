"""Arrays of any memory layout give the same torque, and are neither kept nor written.

What else comes into a step: ``tests/controller/test_inputs.py``.
"""

import mmap
import tempfile

import numpy as np
import pytest

import pinadapt as pa
from tests.support.snapshots import snapshot, unchanged


def read_only(array):
    """Return a copy in read-only memory, as joblib's memory maps are."""
    with tempfile.TemporaryFile() as file:
        file.write(np.ascontiguousarray(array).tobytes())
        file.flush()
        memory = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    return np.frombuffer(memory).reshape(array.shape)


LAYOUTS = {"read-only": read_only, "strided": lambda x: np.repeat(x, 2, axis=-1)[..., ::2]}
LOOPS = {
    "memory": {},
    "natural": {"adaptation": "natural"},
    "set points": {"law": "approximate-jacobian", "adaptation": "natural"},
}


def loop(options):
    """Return a robot, its plant, a controller, its first state, and a set point."""
    robot = pa.load("planar_2r")
    controller = pa.make_controller(robot, **options)
    plant = pa.plants.PinocchioPlant(robot)
    first = plant.measure()
    desired = pa.Desired(first.x.copy(), np.zeros(2), np.zeros(2))
    return robot, plant, controller, controller.init(first), desired


@pytest.mark.parametrize("layout", LAYOUTS)
def test_memory_layouts_give_the_same_and_are_not_written(layout):
    robot, plant, controller, state, desired = loop({})
    lay = LAYOUTS[layout]
    sample = plant.measurement(robot.q0 + 1e-3, np.full(2, 0.1), 1e-3)
    laid = sample._replace(q=lay(sample.q), v=lay(sample.v), x=lay(sample.x))
    expected, _ = controller.step(state, sample, desired, 1e-3)
    found, _ = controller.step(state, laid, pa.Desired(*map(lay, desired)), 1e-3)
    assert found == pytest.approx(expected, rel=1e-12)
    assert np.array_equal(laid.q, sample.q) and np.array_equal(laid.x, sample.x)


@pytest.mark.parametrize("options", LOOPS.values(), ids=LOOPS)
def test_arrays_of_the_caller_are_neither_kept_nor_shared(options):
    robot, plant, controller, state, desired = loop(options)
    for k in range(1, 4):
        sample = plant.measurement(robot.q0 + 1e-3 * k, np.full(2, 0.1), 1e-3 * k)
        given = pa.Desired(*(part.copy() for part in desired))
        torque, state = controller.step(state, sample, given, 1e-3)
        before = snapshot(state)
        for array in (torque, sample.q, sample.v, sample.x, *given):
            array += 9.0
        assert unchanged(state, before)
    wrong = desired._replace(x_d=np.full(2, np.inf))
    with pytest.raises(pa.InputError, match="not finite"), np.errstate(all="ignore"):
        controller.step(state, sample, wrong, 1e-3)
