"""What comes into a step: converted where nothing is lost, refused by name where unusable."""

from functools import cache

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
        rng = np.random.default_rng(5)
        plant = pa.plants.PinocchioPlant(self.robot)
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
        before = snapshot(self.state)
        expected = snapshot(after)
        with pytest.raises(kind, match=words), np.errstate(all="ignore"):
            self.step(**arguments)
        again, after_again = self.step()
        assert unchanged(self.state, before)
        assert again.tobytes() == torque.tobytes() and unchanged(after_again, expected)


loop_of = cache(Loop)


@pytest.fixture(params=LAWS)
def loop(request):
    return loop_of(request.param)


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
def test_all_numeric_types_give_the_same_result(field):
    frame = loop_of(LAWS[0])
    for kind, convert in LOSSLESS.items():
        given = convert(frame.given(field))
        plain = np.array(given, dtype=float)
        torque, after = frame.step(**{field: given})
        expected, after_expected = frame.step(**{field: plain})
        assert torque.dtype == float and torque.tobytes() == expected.tobytes(), kind
        assert unchanged(after, snapshot(after_expected)), kind


def test_signals_that_a_law_does_not_need_may_be_missing():
    joints = loop_of("slotine-li")
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
    "not a number": lambda value: np.where(np.arange(len(value)) == 0, np.nan, value),
    "infinite": lambda value: np.where(np.arange(len(value)) == 0, np.inf, value),
}

BRIDGED = [("None", "x"), ("infinite", "x"), ("None", "xd")]  # by the last frame, by J_hat v


@pytest.mark.parametrize(
    ("law", "field"), [*((LAWS[0], field) for field in OF_FRAME), *((LAWS[1], f) for f in FIELDS)]
)
def test_unusable_signals_are_refused_by_name(law, field):
    loop = loop_of(law)
    kind = pa.MeasurementError
    words = f"'{field}'"
    if field in pa.Desired._fields:
        kind = pa.InputError
        words = rf"desired\.{field}"
    for what, spoil in UNUSABLE.items():
        given = spoil(loop.given(field))
        if (what, field) in BRIDGED:
            assert np.isfinite(loop.step(**{field: given})[0]).all()
        elif what in ("not a number", "infinite") and kind is pa.InputError:
            loop.check_refused(kind, "desired motion is not finite", **{field: given})
        else:
            loop.check_refused(kind, words, **{field: given})


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


def test_what_is_no_state_is_refused(loop):
    with pytest.raises(pa.InputError, match="expected a ControllerState"):
        loop.controller.safe(None, loop.measurement)
