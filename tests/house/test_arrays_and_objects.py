"""Arrays that do not fit: public methods refuse them, and read or write nothing outside of them.

Further tests of arrays and objects: what comes into a step, ``tests/controller/test_inputs.py``;
copies, threads and limits, ``tests/controller/test_copies.py`` and ``test_guards.py``; laws and
adaptations of a user's own, ``tests/controller/test_own_objects.py``; the sizes that each kernel
checks, ``tests/kernels/test_kernels.py``.
"""

import mmap
import tempfile

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.adaptation import Drive, Estimate
from pinadapt.exceptions import ArrayError
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
    drive, bodies = np.full(a.size, 0.01), np.zeros((6, dyn.inertial.size))

    def step(value, gradient):
        return ad.step(Estimate(value), Drive(gradient[None], np.ones(1), gradient=gradient), 1e-3)

    return {
        "kinematics.update": (kin.update, [kin.initial, q, v]),
        "dynamics.load": (dyn.load, [a]),
        "dynamics.torque": (dyn.torque, [q, v, v]),
        "dynamics.regressor": (dyn.regressor, [q, v, v]),
        "dynamics.slotine_li": (dyn.slotine_li, [q, v, v, v]),
        "dynamics.momentum": (dyn.momentum, [q, v]),
        "joints.regressor": (lambda *given: dyn.joints.regressor(q, *given, bodies), [v, v]),
        "posture.offset": (law.posture.offset, [q]),
        "posture.acceleration": (law.posture.acceleration, [q, v]),
        "adaptation.step": (step, [a, drive]),
        "adaptation.gain": (ad.gain, [a]),
    }


METHODS = (
    "kinematics.update",
    "dynamics.load",
    "dynamics.torque",
    "dynamics.regressor",
    "dynamics.slotine_li",
    "dynamics.momentum",
    "joints.regressor",
    "posture.offset",
    "posture.acceleration",
    "adaptation.step",
    "adaptation.gain",
)


@pytest.mark.parametrize("name", METHODS)
def test_an_array_that_is_too_short_is_refused(name, loop):
    method, arrays = methods(loop)[name]
    method(*arrays)
    for k, array in enumerate(arrays):
        for short in (array[..., :-1], array[..., :0], array[..., : array.shape[-1] // 2]):
            with pytest.raises(pa.InputError):
                method(*arrays[:k], short, *arrays[k + 1 :])


DOORS = {
    "validate": [np.zeros(3), "x", None, [[1.0]], np.zeros((1, 84)), np.zeros(84, complex)],
    "divergence": [np.zeros(3), 0.5, np.zeros((84, 1)), [1.0, [2.0]]],
    "storage": [
        None,
        "x",
        Estimate(np.zeros(3)),
        Estimate([0.0] * 84),
        Estimate(np.zeros(84, int)),
    ],
    "error": [0.5, np.zeros(1), np.zeros((1, 3)), np.zeros(4), "abc"],
    "mismatch": [np.zeros(6), np.zeros((3, 5)), None],
    "robot": [np.zeros(3), "x", None],
    "friction": [0.1, np.zeros(5), np.zeros((6, 1)), None],
    "base": [None, "x", 0.5, -1, True],
}


@pytest.mark.parametrize("name", DOORS)
def test_a_door_names_the_method_and_the_argument(name, loop):
    controller, state = loop
    ad, kin, robot = controller.adaptation_d, controller.kinematics, controller.motion.robot
    true, x, J = state.a_d, robot.position(robot.q0), np.zeros((3, 6))
    law = controller.law
    method, where = {
        "validate": (ad.validate, r"\w+.validate: value"),
        "divergence": (lambda bad: ad.divergence(true, bad), r"\w+.divergence: truth"),
        "storage": (lambda bad: ad.storage(bad, true), r"\w+.storage: estimate"),
        "error": (lambda bad: kin.task.error(x, bad), "PositionTask.error: x_d"),
        "mismatch": (lambda bad: law.mismatch(J, bad), "AdaptiveJacobian.mismatch: J"),
        "robot": (lambda bad: controller.dynamics.robot(bad, robot), "StackedDynamics.robot: a_d"),
        "friction": (robot.friction.torque, "Friction.torque: v"),
        "base": (kin.base, "FrameKinematics.base: samples"),
    }[name]
    for bad in DOORS[name]:
        with pytest.raises(pa.InputError, match=f"^{where}"):
            method(bad)


def test_a_method_of_a_step_says_what_it_was_given_and_what_it_asks_for(loop):
    kin, q = loop[0].kinematics, np.zeros(6)
    words = (
        r"^FrameKinematics.update: .*a_k \(3,\) of int64, q \(6,\), v \(6,\)\. Its descr.*\(nq\)"
    )
    with pytest.raises(ArrayError, match=words):
        kin.update(np.zeros(3, dtype=np.int64), q, q)
    with pytest.raises(ArrayError, match=r"StackedDynamics.torque: .*q \(5,\), v \(6,\)"):
        loop[0].dynamics.torque(q[:5], q, q)
    assert kin.task.error([1, 2, 3], np.ones(3)).tolist() == [0.0, 1.0, 2.0]


def read_only(array):
    """Return a copy in memory that the system does not let anybody write, as joblib's maps are."""
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
    if isinstance(result, Estimate):
        return [result.value]
    if isinstance(result, np.ndarray):
        return [np.array(result)]
    return [] if result is None else [np.array(each) for each in result]


LOOPS = {
    "memory": {},
    "natural": {"adaptation": "natural"},
    "set points": {"law": "approximate-jacobian", "adaptation": "natural"},
}


@pytest.mark.parametrize("options", LOOPS.values(), ids=LOOPS)
def test_what_goes_out_and_comes_in_is_the_callers(options):
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
    for part, value in (("x_d", np.inf), ("x_d", -np.inf), ("x_d", np.nan)):
        wrong = pa.Desired(first.x, *np.zeros((2, 2)))._replace(**{part: np.full(2, value)})
        with pytest.raises(pa.InputError, match="not finite"), np.errstate(all="ignore"):
            controller.step(state, plant.measurement(robot.q0, np.zeros(2), 0.004), wrong, 1e-3)
        with pytest.raises(pa.InputError, match="not finite"):
            controller.observe(state, plant.measurement(robot.q0, np.zeros(2), 0.004), wrong)
