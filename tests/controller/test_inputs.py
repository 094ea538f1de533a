"""What comes into a step: converted where nothing is lost, refused by name where unusable."""

import numpy as np
import pytest

import pinadapt as pa
from tests.support.chains import robot_of
from tests.support.loops import motion_at_home
from tests.support.snapshots import snapshot, unchanged

DT = 1e-3  # [s], the period of the controllers
LAWS = ["adaptive-jacobian", "slotine-li"]  # one uses all signals, one those of the joints alone


class Loop:
    """A controller a few steps into its work, with what comes into the next one."""

    def __init__(self, law):
        self.robot = robot_of(law, "ur5")
        self.controller = pa.make_controller(self.robot.changed(inertial_scale=0.8), law=law)
        rng, plant = np.random.default_rng(5), pa.plants.PinocchioPlant(self.robot)
        q = plant.integrate(self.robot.q0, 0.05 * rng.standard_normal(6))
        self.measurement = plant.measurement(q, 0.3 * rng.standard_normal(6))
        self.desired = motion_at_home(self.robot).at(0.1)
        self.state = self.controller.init(self.measurement)
        for _ in range(3):
            _, self.state = self.step()

    def step(self, state=None, dt=DT, **fields):
        """Step from the state, with these fields of measurement and desired motion."""
        measured = {name: value for name, value in fields.items() if name not in pa.Desired._fields}
        wanted = {name: value for name, value in fields.items() if name in pa.Desired._fields}
        return self.controller.step(
            self.state if state is None else state,
            self.measurement._replace(**measured),
            self.desired._replace(**wanted),
            dt,
        )

    def given(self, field):
        """Return a field of the measurement or of the desired motion."""
        return getattr(self.desired if field in pa.Desired._fields else self.measurement, field)

    def check_refused(self, kind, words, **arguments):
        """An error of this kind comes, and the state is as good as before."""
        torque, after = self.step()
        before, expected = snapshot(self.state), snapshot(after)
        with pytest.raises(kind, match=words), np.errstate(all="ignore"):
            self.step(**arguments)
        again, after_again = self.step()
        assert unchanged(self.state, before)
        assert again.tobytes() == torque.tobytes() and unchanged(after_again, expected)


@pytest.fixture(params=LAWS, scope="module")
def loop(request):
    return Loop(request.param)


@pytest.fixture(scope="module")
def frame():
    """Return the loop of a law of the frame, which measures x and xd."""
    return Loop(LAWS[0])


FIELDS = ["q", "v", "x_d", "xd_d", "xdd_d"]
OF_FRAME = [*FIELDS, "x", "xd"]

# --- converted ---

LOSSLESS = {
    "big-endian": lambda value: value.astype(">f8"),
    "list": lambda value: value.tolist(),
    "read-only": lambda value: np.frombuffer(value.tobytes()),
    "float32": lambda value: value.astype(np.float32),
    "list of integers": lambda value: [round(number) for number in value],
}


@pytest.mark.parametrize("field", OF_FRAME)
def test_all_numeric_types_give_the_same_result(frame, field):
    for kind, convert in LOSSLESS.items():
        given = convert(frame.given(field))
        plain = np.array(given, dtype=float)
        torque, after = frame.step(**{field: given})
        expected, after_expected = frame.step(**{field: plain})
        assert torque.dtype == float and torque.tobytes() == expected.tobytes(), kind
        assert unchanged(after, snapshot(after_expected)), kind


def test_signals_that_a_law_does_not_need_may_be_missing():
    joints = Loop("slotine-li")
    assert joints.step(x=None, xd=None, a=None, tau=None)[0].tobytes() == joints.step()[0].tobytes()
    seen = joints.step(x=np.zeros(3), x_time=0.0, xd=np.zeros(3))  # of the frame, by a tracker
    assert seen[0].tobytes() == joints.step()[0].tobytes()


# --- refused ---

UNUSABLE = {
    "None": lambda value: None,
    "one number": lambda value: 0.5,
    "too few": lambda value: value[:-1],
    "column": lambda value: value[:, None],
    "strings of numbers": lambda value: [str(number) for number in value],
    "ragged": lambda value: [[1.0], *value[1:].tolist()],
    "complex": lambda value: value + 0.0j,
    "truth values": lambda value: value > 0.0,
}


@pytest.mark.parametrize("field", FIELDS)
def test_signals_of_the_wrong_shape_are_refused_by_name(loop, field):
    desired = field in pa.Desired._fields
    kind, words = (
        (pa.InputError, rf"desired\.{field}") if desired else (pa.MeasurementError, f"'{field}'")
    )
    for spoil in UNUSABLE.values():
        loop.check_refused(kind, words, **{field: spoil(loop.given(field))})


@pytest.mark.parametrize("spoil", UNUSABLE.values(), ids=UNUSABLE.keys())
@pytest.mark.parametrize("field", ["x", "xd"])
def test_frame_measurements_of_the_wrong_shape_are_refused_by_name(frame, field, spoil):
    given = spoil(frame.given(field))
    if given is None:  # J_hat v stands for xd, the last frame for x
        assert np.isfinite(frame.step(**{field: None})[0]).all()
    else:
        frame.check_refused(pa.MeasurementError, f"'{field}'", **{field: given})


@pytest.mark.parametrize("field", FIELDS)
def test_numbers_that_are_not_finite_are_refused(loop, field):
    desired = field in pa.Desired._fields
    kind, words = (pa.InputError, "desired") if desired else (pa.MeasurementError, f"'{field}'")
    for number in (np.nan, np.inf, -np.inf):
        spoilt = np.array(loop.given(field))
        spoilt[0] = number
        loop.check_refused(kind, words, **{field: spoilt})


@pytest.mark.parametrize(
    "dt",
    [0.0, -DT, np.nan, np.inf, 10.01 * DT, None, "1e-3", "fast", [DT, DT], 1j, np.full(2, DT)],
    ids=repr,
)
def test_an_impossible_period_is_refused(loop, dt):
    loop.check_refused(pa.InputError, "dt: must be positive and at most 0.01 s", dt=dt)


# --- states ---


OTHERS = {
    "other robot": ("panda", {}),
    "parameters of joints": ("ur5", {"unknown": pa.Unknown(friction=True, armature=True)}),
}


@pytest.mark.parametrize(("name", "options"), OTHERS.values(), ids=OTHERS.keys())
def test_the_state_of_another_controller_is_refused(loop, name, options):
    law = loop.controller.law.name
    robot = robot_of(law, name)
    other = pa.make_controller(robot, law=law, **options).init(
        pa.plants.PinocchioPlant(robot).measure()
    )
    loop.check_refused(pa.InputError, "state", state=other)
