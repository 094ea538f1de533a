"""Arrays that do not fit: public methods refuse them, and read or write nothing outside of them.

Further tests of arrays and objects: what comes into a step, ``tests/controller/test_inputs.py``;
copies, threads and limits, ``tests/controller/test_copies.py`` and ``test_guards.py``; laws and
adaptations of a user's own, ``tests/controller/test_own_objects.py``; the sizes that each kernel
checks, ``tests/kernels/test_kernels.py``.
"""

import copy
import mmap
import tempfile
from contextlib import suppress

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


def calls(loop):
    """Yield a name, a public method, and arguments that fit it."""
    controller, state = loop
    robot, law, kin, dyn = (
        controller.motion.robot,
        controller.law,
        controller.kinematics,
        controller.dynamics,
    )
    plant = pa.plants.PinocchioPlant(robot)
    q, v, a = robot.q0, np.full(6, 0.1), np.full(6, 0.2)
    sample = plant.measurement(q, v, 1e-3)
    x, still, M = sample.x, np.zeros(3), np.eye(6)
    signals = controller.observe(state, sample, pa.Desired(x, still, still))
    command = law.command(signals, controller._model(state, signals, 1e-3))
    inside, joints, task = dyn.inertial, dyn.joints, kin.task
    sensors = pa.plants.SimulatedSensors(robot, 1e-3, pa.Sensors())
    filters = pa.filters.FilteredRegressor(dyn, 30.0)
    held = filters.init(q, v)
    now = filters.observe(held, q, v, np.zeros(6))
    circle = pa.trajectories.Circle([0.5, 0.0, 0.4], 0.1, 3.0)
    ad, dynamic, true = controller.adaptation_d, state.dynamic, state.a_d * 1.01
    drive = command.drives.dynamic
    small = np.arange(1.0, 5.0)
    rng = np.random.default_rng(0)
    news = Drive(rng.normal(size=(2, 4)), np.ones(2), rng.normal(size=(3, 4)), np.ones(3))
    squares = pa.adaptation.LeastSquares(np.eye(4), 4)
    memory = pa.adaptation.CompositeMemory(
        pa.adaptation.Gradient(2.0, 4), 10.0, rate=1.0, noise=np.ones(3)
    )
    zone = pa.adaptation.DeadZone(pa.adaptation.Gradient(2.0, 4), 0.1)
    leak = pa.adaptation.Leak(pa.adaptation.Gradient(2.0, 4), 1.0)
    yield from (
        ("kinematics", kin.update, {"a_k": kin.initial, "q": q, "v": v}),
        ("kinematics", kin.at, {"q": q}),
        ("kinematics", kin.acceleration_regressor, {"a": a}),
        ("kinematics", kin.between, {"q_0": q, "q_1": q, "share": 0.5}),
        ("dynamics", dyn.load, {"a_d": state.a_d}),
        ("dynamics", dyn.torque, {"q": q, "v": v, "a": a}),
        ("dynamics", dyn.mass_matrix, {"q": q}),
        ("dynamics", dyn.momentum, {"q": q, "v": v}),
        ("bodies", inside.regressor, {"q": q, "v": v, "a": a}),
        ("bodies", inside.slotine_li, {"q": q, "v": v, "v_r": v, "a_r": a}),
        ("bodies", inside.expand, {"a_d": inside.initial}),
        ("bodies", inside.reduce, {"Y": np.ones((6, 60))}),
        ("joints", joints.robot, {"a_j": joints.initial, "nominal": robot}),
        ("momentum", pa.models.MomentumRegressor(robot.model), {"q": q, "v": v}),
        ("posture", law.posture.coordinates, {"q": q}),
        ("law", law.mismatch, {"J_hat": signals.J.copy(), "J": signals.J.copy()}),
        ("command", command.at, {"a": a}),
        ("task", task.errors, {"x": x, "x_d": x, "xd": still, "xd_hat": still, "xd_d": still}),
        ("task", task.position, {"x": x}),
        ("task", task.moved, {"x": x, "by": still}),
        ("natural", ad.step, {"estimate": dynamic, "drive": drive, "dt": 1e-3}),
        ("natural", ad.project, {"estimate": dynamic, "q": q}),
        ("natural", ad.divergence, {"value": state.a_d, "truth": true}),
        ("squares", squares.step, {"estimate": squares.init(small), "drive": news, "dt": 1e-3}),
        ("squares", squares.metric, {"estimate": squares.init(small)}),
        ("squares", squares.gain_times, {"value": small, "X": np.ones((4, 2))}),
        ("memory", memory.rate, {"estimate": memory.init(small), "drive": news}),
        ("memory", memory.informed, {"estimate": memory.init(small), "H": np.eye(4)}),
        ("zone", zone.rate, {"estimate": zone.init(small), "drive": news}),
        ("leak", leak.recorded, {"estimate": leak.init(small)}),
        ("cone", ad.parts[0][0].cone.covectors, {"g": inside.initial}),
        ("plant", plant.motors, {"torque": v}),
        ("plant", plant.acceleration_at, {"q": q, "v": v, "tau": v, "feedthrough": 0.01 * M}),
        ("plant", plant.measurement, {"q": q, "v": v, "t": 0.1}),
        ("plant", plant.integrate, {"q": q, "step": v}),
        ("plant", plant.steps_in, {"dt": 1e-3}),
        ("sensors", sensors.measure, {"truth": sample, "torque": v}),
        ("filters", filters.observe, {"state": held, "q": q, "v": v, "tau": v}),
        ("filters", filters.step, {"now": now, "tau": v, "dt": 1e-3}),
        ("low pass", pa.filters.LowPass(9.0).advance, {"state": a, "u": v, "dt": 1e-3}),
        ("circle", circle.at, {"t": 0.3}),
        ("circle", lambda by: circle.shifted(by).at(0.3), {"by": still}),
        ("circle", circle.positions, {"times": v}),
        ("start", circle.from_rest(1.0).law.when, {"s": 0.3}),
        ("picture", pa.tasks.pinhole_camera, {"position": x, "target": still, "focal": 900.0}),
        ("robot", robot.position, {"q": q}),
        (
            "controller",
            lambda torque: controller.limited(torque).limits.torque,
            {"torque": np.full(6, 5.0)},
        ),
        (
            "controller",
            controller.step,
            {
                "state": state,
                "measurement": sample,
                "desired": pa.Desired(x, still, still),
                "dt": 1e-3,
            },
        ),
    )


def hostile(value):
    """Yield a word, a value in place of an argument, and the floats that it means, None if none."""
    if isinstance(value, float):
        yield "a whole number", 1, 1.0
        for word, bad in {"text": "x", "nothing": None, "array": np.ones(3), "1j": 1j}.items():
            yield word, bad, None
        yield "nan", np.nan, None
        yield "inf", np.inf, None
    elif isinstance(value, np.ndarray):
        whole = np.round(value)
        yield "integers", whole.astype(int), whole
        yield "of the other byte order", value.astype(">f8"), value
        yield "single precision", whole.astype(np.float32), whole
        yield "strided", np.repeat(value, 2, axis=-1)[..., ::2], value
        for word, bad in {
            "short": value[..., :-1],
            "long": np.concatenate([value, value[..., :1]], -1),
            "empty": value[..., :0],
            "deeper": value[None],
            "one": value.ravel()[:1],
            "number": 0.3,
            "text": np.full(value.shape, "x"),
            "objects": np.full(value.shape, None),
            "complex": value.astype(complex),
            "ragged": [[1.0], [1.0, 2.0]],
            "word": "abc",
        }.items():
            yield word, bad, None
        if value.ndim == 2:
            yield "a row less", value[:-1], None
    else:
        parts = getattr(value, "__slots__", getattr(value, "_fields", ()))
        for part in parts:
            inner = getattr(value, part)
            if isinstance(inner, np.ndarray):
                for word, bad, good in hostile(inner):
                    same = None if good is None else changed(value, part, good)
                    yield f"{part} {word}", changed(value, part, bad), same
        if isinstance(value, Estimate):
            for i, inner in enumerate(value.memory):
                for word, bad, _ in hostile(inner):
                    memory = (*value.memory[:i], bad, *value.memory[i + 1 :])
                    yield f"memory {word}", Estimate(value.value, memory), None
        for bad in (None, "x", np.ones(3), 3.0):
            yield "no object", bad, None


def changed(value, part, inner):
    """Return a copy of a record with another part."""
    if hasattr(value, "_replace"):
        return value._replace(**{part: inner})
    other = copy.copy(value)
    setattr(other, part, inner)
    return other


# name, argument and hostile value of calls that are legitimate
LEGITIMATE = {
    ("squares", "X", "short"): "any number of columns",
    ("squares", "X", "long"): "any number of columns",
    ("squares", "X", "empty"): "any number of columns",
    ("circle", "times", "short"): "any number of times",
    ("circle", "times", "long"): "any number of times",
    ("circle", "times", "one"): "any number of times",
    ("circle", "times", "empty"): "any number of times",
    ("circle", "by", "number"): "a number fills a displacement",
    ("controller", "torque", "number"): "one limit for all joints",
}


def test_hostile_calls_get_a_typed_error_or_the_right_result(loop):
    """No silent error: wrong sizes, kinds of numbers and objects are refused by public methods."""
    wrong, untyped, made = [], [], 0
    for name, method, fitting in calls(loop):
        for argument, value in fitting.items():
            for word, bad, good in hostile(value):
                call, made = (name, argument, word), made + 1
                try:
                    found = flat(method(**{**fitting, argument: bad}))
                except pa.PinadaptError:
                    continue
                except Exception as error:
                    untyped.append((*call, repr(error)))
                    continue
                if call in LEGITIMATE:
                    continue
                as_good = value if good is None else good  # what is not used changes nothing
                right = flat(method(**{**fitting, argument: as_good}))
                wrong += [] if same(found, right) else [call]
    assert (wrong, untyped) == ([], [])
    assert made > 1500


def arrays_of(part, put):
    """Yield each array in nested records, and a function that makes the whole with another one."""
    if isinstance(part, np.ndarray):
        yield part, put
    elif isinstance(part, Estimate):
        yield from arrays_of(part.memory, lambda new: put(Estimate(part.value, new)))
    elif isinstance(part, tuple):
        for i, inner in enumerate(part):

            def within(new, i=i):
                items = [*part[:i], new, *part[i + 1 :]]
                return put(part._make(items) if hasattr(part, "_make") else tuple(items))

            yield from arrays_of(inner, within)


def test_arrays_of_other_shapes_in_a_state_are_refused_or_not_used():
    robot = catalogue_robot("ur5")
    controller = pa.make_controller(robot)
    plant, v, still = pa.plants.PinocchioPlant(robot), np.full(6, 0.1), np.zeros(3)
    first, *samples = (plant.measurement(robot.q0 + v * k * 1e-3, v, k * 1e-3) for k in range(4))
    state, desired = controller.init(first), pa.Desired(first.x, still, still)
    for sample in samples[:2]:
        state = controller.step(state, sample, desired, 1e-3)[1]
    right, refused, arrays = controller.step(state, samples[2], desired, 1e-3)[0], 0, 0
    for array, put in arrays_of(state, lambda new: new):
        arrays += 1
        for word, bad, good in hostile(array):
            if good is not None or word in ("text", "objects", "complex"):  # numbers, of a kind
                continue
            try:
                torque = controller.step(put(bad), samples[2], desired, 1e-3)[0]
                assert same([torque], [right]), word
            except pa.PinadaptError:
                refused += 1
        with suppress(pa.PinadaptError):
            controller.safe(put(array[None]), samples[2])
    assert arrays > 20 and refused > 100


def same(found, right):
    """Return whether two results are the same."""
    return len(found) == len(right) and all(
        a.shape == b.shape
        and (not a.size or a.dtype.kind == b.dtype.kind)
        and np.allclose(a, b, rtol=1e-9, atol=1e-12, equal_nan=True)
        for a, b in zip(found, right, strict=True)
    )


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
def test_an_error_names_the_method_and_the_argument(name, loop):
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
    words = r"^FrameKinematics.update: .*a_k \(3,\), q \(5,\), v \(6,\)\. Its descr.*\(nq\)"
    with pytest.raises(ArrayError, match=words):
        kin.update_unchecked(np.zeros(3), q[:5], q)
    with pytest.raises(ArrayError, match=r"StackedDynamics.torque: .*q \(5,\), v \(6,\)"):
        loop[0].dynamics.torque_unchecked(q[:5], q, q)
    assert kin.task.error([1, 2, 3], np.ones(3)).tolist() == [0.0, 1.0, 2.0]


def test_absurd_counts_and_durations_end_at_once(loop):
    controller = loop[0]
    robot, kin, dyn = controller.motion.robot, controller.kinematics, controller.dynamics
    plant, still = pa.plants.PinocchioPlant(robot), np.zeros(6)
    for absurd in (
        lambda: plant.step(still, 1e29),
        lambda: plant.hold(still, 100.1),
        lambda: kin.base(10**9),
        lambda: pa.models.base_parameters(dyn, robot, samples=10**9),
        lambda: pa.adaptation.Gradient(1.0, 10**9),
        lambda: pa.excite(robot, harmonics=10**9),
    ):
        with pytest.raises(pa.InputError, match="at most"):
            absurd()
    for dt in (0.0, -1e-3, np.nan, np.inf, 1e300):
        with pytest.raises(pa.InputError, match=r"PinocchioPlant.step: dt: expected a positive"):
            plant.step(still, dt)
    with pytest.raises(pa.DivergedError, match="not finite"):
        plant.step(np.full(6, np.nan), 1e-3)
    assert plant.measure().t == 0.0


def test_a_state_that_does_not_fit_is_refused(loop):
    controller, state = loop
    sample = pa.plants.PinocchioPlant(controller.motion.robot).measurement(
        controller.motion.robot.q0, np.zeros(6), 1e-3
    )
    wrong = state._replace(sensed=state.sensed._replace(trail="x"))
    with pytest.raises(pa.InputError, match=r"^state: there is no going on from it"):
        controller.step(wrong, sample, pa.Desired(sample.x, *np.zeros((2, 3))), 1e-3)


def test_errors_of_a_users_own_code_stay_and_overrides_have_their_twin():
    class Own(pa.adaptation.Adaptation):
        def rate(self, estimate, drive):
            raise ValueError("of my own")

        def divergence(self, value, truth):
            return None

    own, drive = Own(), Drive(np.ones((1, 2)), np.ones(1))
    for call in (own.rate, own.rate_unchecked, own.value_rate):
        with pytest.raises(ValueError, match=r"^of my own$"):
            call(Estimate(np.ones(2)), drive)
    with pytest.raises(pa.InputError, match=r"^Own.rate: estimate"):
        own.rate(None, drive)


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
    if isinstance(result, float | int | np.ndarray):
        return [np.array(result)]
    if isinstance(result, pa.Robot):
        return [result.friction.viscous, result.friction.coulomb, np.array(result.model.armature)]
    if isinstance(result, pa.Measurement):
        return [np.array(each) for each in result if each is not None]
    parts = getattr(result, "__slots__", None) or result or ()
    if not isinstance(result, tuple | list):
        parts = [getattr(result, name) for name in getattr(result, "__slots__", ())]
    return [array for each in parts for array in flat(each)] if parts else []


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


@pytest.mark.parametrize("kind", [pa.laws.Law, pa.adaptation.Adaptation, pa.plants.Plant])
def test_an_abstract_class_asks_for_its_methods_alone(kind):
    with pytest.raises(TypeError, match="abstract methods") as error:
        kind()
    assert "unchecked" not in str(error.value)
