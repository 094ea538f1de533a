"""A user's own laws and adaptations, and ours given as objects, in place of their names."""

import copy
import pickle
import re

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.adaptation import Drive, Estimate
from tests.support.chains import catalogue_robot
from tests.support.drives import along
from tests.support.loops import energy_along, motion_at_home, with_tool_and_load
from tests.support.paths import ROOT
from tests.support.replays import record, replay
from tests.support.snapshots import snapshot, unchanged

GUIDE = ROOT / "docs" / "your_own_law.md"
JACOBIAN = "adaptive-jacobian"


@pytest.fixture(scope="module")
def guide():
    """Return the names that the guide's blocks define, run in order."""
    scope = {"__name__": "guide"}
    for block in re.findall(r"```python\n(.*?)```", GUIDE.read_text(), re.DOTALL):
        exec(block, scope)
    return scope


# --- the guide ---


def error_at_the_end(rollout):
    """Return the error of each joint at the end [deg]."""
    return np.degrees(np.abs(rollout.error[-1]))


def test_the_law_of_the_guide_reaches_its_set_point(guide):
    assert guide["rollout"].diverged is None
    assert error_at_the_end(guide["rollout"]).max() < 0.1


def test_without_adaptation_a_wrist_is_off_as_the_guide_states(guide):
    controller = pa.make_controller(guide["robot"], law=guide["law"], adaptation="none", dt=4e-3)
    path = pa.trajectories.Hold(guide["robot"].home_angles + 0.2)
    error = error_at_the_end(pa.simulate(guide["true"], controller, path, duration=5.0))
    assert error.argmax() == 3 and error[3] == pytest.approx(5.8, abs=0.05)


def test_storage_of_the_guides_law_falls_with_an_adaptation_that_has_one(guide):
    dt = 2.5e-4  # V of a sampled loop falls where the samples are dense
    controller = pa.make_controller(guide["robot"], law=guide["law"], adaptation="natural", dt=dt)
    step = pa.trajectories.Hold(guide["robot"].home_angles + 0.2).as_given()  # a law for points
    rollout = pa.simulate(guide["true"], controller, step, duration=1.0)
    assert rollout.diverged is None
    assert (np.diff(rollout.lyapunov) < 0.0).all()
    assert rollout.lyapunov[-1] < 0.5 * rollout.lyapunov[0]


def test_the_closed_loop_of_the_guide_obeys_its_proof(guide):
    controller = pa.make_controller(guide["robot"], law=guide["law"], gamma_d=1.0)
    path = pa.trajectories.Hold(guide["robot"].home_angles + 0.2)
    energy = energy_along(guide["true"], controller, path, seconds=0.006)
    assert energy.mismatch() <= 1e-6 and np.abs(energy.rate).max() > 1e-4


# --- our own as objects ---


def wrong(robot):
    return robot.changed(inertial_scale=0.8)


def test_a_law_as_an_object_is_the_one_by_name_with_the_same_gains():
    robot = catalogue_robot("panda")
    own = {"alpha": 5.0, "R_k": 30.0, "lambda_": 12.0}
    posture = pa.laws.Posture(wrong(robot), frequency=6.0)
    law = pa.laws.AdaptiveJacobian(robot.task, posture, K_v=90.0, K_P=800.0, **own)
    gains = {"Kv": 90.0, "Kp": 800.0, "posture": 6.0, **own}
    by_name = pa.make_controller(wrong(robot), law=JACOBIAN, **gains)
    by_object = pa.make_controller(wrong(robot), law=law)
    samples = record(with_tool_and_load(robot), by_name, motion_at_home(robot))
    (torques, state), (same, end) = (replay(each, samples) for each in (by_name, by_object))
    assert same.tobytes() == torques.tobytes() and unchanged(end, snapshot(state))
    assert by_object.law is law


@pytest.mark.parametrize("kind", ["natural", "gradient", "projected"])
def test_an_adaptation_as_an_object_is_the_one_by_name(kind):
    robot = catalogue_robot("panda")
    by_name = pa.make_controller(wrong(robot), adaptation=kind)
    by_object = pa.make_controller(
        wrong(robot),
        adaptation=by_name.adaptation_d,
        kinematic_adaptation=by_name.adaptation_k,
        R_k=by_name.law.R_k[0, 0],
    )
    samples = record(with_tool_and_load(robot), by_name, motion_at_home(robot))
    (torques, state), (same, end) = (replay(each, samples) for each in (by_name, by_object))
    assert same.tobytes() == torques.tobytes() and unchanged(end, snapshot(state))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"law": pa.laws.AdaptiveJacobian}, "a name or a Law"),
        ({"law": 3}, "a name or a Law"),
        ({"adaptation": pa.adaptation.Natural}, "a name or an Adaptation"),
        ({"adaptation": 3.0}, "a name or an Adaptation"),
    ],
    ids=str,
)
def test_objects_of_the_wrong_kind_are_refused(options, words):
    with pytest.raises(pa.InputError, match=words):
        pa.make_controller(catalogue_robot("ur5"), **options)


def test_a_law_as_an_object_takes_no_further_gains():
    robot = catalogue_robot("ur5")
    law = pa.laws.AdaptiveJacobian(
        robot.task, pa.laws.Posture(robot), K_v=90.0, K_P=800.0, alpha=5.0
    )
    with pytest.raises(pa.InputError, match=r"has its gains; got \['Kv'\]"):
        pa.make_controller(robot, law=law, Kv=40.0)


# --- wrappers around any adaptation ---

INNER = ["gradient", "natural", "own"]


def inner_of(kind, dynamics, guide):
    """Return an adaptation of a robot's bodies."""
    if kind == "own":
        return guide["Normalised"](Gamma=1.0, T=0.1)
    if kind == "natural":
        return pa.adaptation.Natural(
            5.0, pa.adaptation.BodyInequality(catalogue_robot("ur5").joint_names)
        )
    return pa.adaptation.Gradient(1.0, dynamics.size)


@pytest.mark.parametrize("kind", INNER)
def test_a_box_bounds_any_adaptation(kind, guide):
    dynamics = pa.models.BodyDynamics(catalogue_robot("ur5"))
    inner, a = inner_of(kind, dynamics, guide), dynamics.initial
    low, high = a - 0.01 * np.abs(a) - 1e-3, a + 0.01 * np.abs(a) + 1e-3
    boxed, rng = pa.adaptation.BoxProjection(inner, low, high), np.random.default_rng(1)
    free, held = inner.init(a), boxed.init(a)
    drive = along(1e-6 * rng.standard_normal(a.size))  # so short a step that no wall is met
    assert unchanged(boxed.step(held, drive, 1e-3), snapshot(inner.step(free, drive, 1e-3)))
    left = 0
    for _ in range(30):
        drive = along(30.0 * rng.standard_normal(a.size))
        free, held = inner.step(free, drive, 1e-2), boxed.step(held, drive, 1e-2)
        left += not ((low <= free.value) & (free.value <= high)).all()
        assert ((low <= held.value) & (held.value <= high)).all() and boxed.contains(held.value)
        if kind == "own":
            assert unchanged((held.memory,), snapshot((free.memory,)))  # it remembers as before
    assert left > 0  # without the box it leaves


def mass_matrix(dynamics, a, q):
    """Return M_hat (n, n) at an estimate."""
    dynamics.load(a)
    return np.array(dynamics.mass_matrix(q))


@pytest.mark.parametrize("kind", INNER)
def test_the_mass_matrix_stays_positive_with_any_adaptation(kind, guide):
    robot = catalogue_robot("ur5")
    dynamics = pa.models.BodyDynamics(robot)
    projected = pa.adaptation.MassMatrixProjection(inner_of(kind, dynamics, guide), dynamics, robot)
    rng, estimate, moved = np.random.default_rng(2), projected.init(0.05 * dynamics.initial), 0
    M_0 = mass_matrix(dynamics, dynamics.initial, robot.q0)
    for _ in range(50):
        kept = projected.project(estimate, robot.q0)
        moved += kept is not estimate.value
        M_hat = mass_matrix(dynamics, kept, robot.q0)
        assert np.linalg.eigvals(np.linalg.solve(M_0, M_hat)).real.min() >= 0.1 - 1e-9
        assert projected.contains(kept)
        drive = along(rng.standard_normal(dynamics.size))
        estimate = projected.step(estimate.with_value(kept), drive, 1e-3)
    assert moved > 0


# --- memory, rest, signals ---


def test_the_memory_of_an_adaptation_is_integrated_in_continuous_mode(guide):
    """The rate of the memory is integrated with the rest: fine samples tend to the same."""
    robot, true = guide["robot"], guide["true"]
    path, ends = pa.trajectories.Hold(robot.home_angles + 0.2), {}
    for mode, dt in (("continuous", 1e-3), ("sampled", 1e-4), ("sampled", 5e-5)):
        adaptation = guide["Normalised"](Gamma=30.0, T=0.05)
        controller = pa.make_controller(
            robot, law=guide["law"], adaptation=adaptation, dt=dt, limits=pa.Limits(torque=False)
        )
        plant = pa.plants.PinocchioPlant(true)
        if mode == "continuous":
            start = controller.init(plant.measure())
            stream = pa.simulation.run_continuous(plant, controller, path, dt=dt, state=start)
        else:
            stream = pa.run(plant, controller, path, dt=dt)
        for sample in stream:
            if sample.t >= 0.05 - 1e-9:
                break
        ends[mode, dt] = np.concatenate([sample.state.a_d, *sample.state.dynamic.memory])
    exact, coarse, fine = ends.values()
    start = np.append(controller.dynamics.initial, 0.0)
    moved = np.abs(exact - start)
    assert moved[-1] > 1e-3 and moved[:-1].max() > 1e-3  # the memory and the estimate
    errors = [np.linalg.norm(end - exact) for end in (coarse, fine)]
    assert errors[1] < 0.6 * errors[0] and errors[0] < 0.01 * np.linalg.norm(exact - start)


def test_a_state_with_memory_is_one_flat_array_and_back(guide):
    controller, robot = guide["controller"], guide["robot"]
    state = replay(controller, record(guide["true"], controller, motion_at_home(robot)))[1]
    flat = state.flat()
    assert state.dynamic.memory[0][0] in flat
    assert unchanged(state.with_flat(flat), snapshot(state))
    assert np.array_equal(state.with_flat(2.0 * flat).flat(), 2.0 * flat)


@pytest.mark.parametrize("law", ["adaptive-inverse-dynamics", JACOBIAN])
def test_estimates_rest_until_adaptation_is_enabled(law):
    robot = catalogue_robot("ur5")
    controller = pa.make_controller(wrong(robot), law=law)
    samples = record(with_tool_and_load(robot), controller, motion_at_home(robot))
    start = controller.init(samples[0][0], adapting=False)
    _, state = replay(controller, samples, adapting=False)
    assert not start.adapting and not state.adapting
    assert unchanged((state.dynamic, state.kinematic), snapshot((start.dynamic, start.kinematic)))
    assert not unchanged(state.filters, snapshot(start.filters))  # they go on
    sample, desired = samples[-1]
    then, later = (sample._replace(t=sample.t + k * 1e-3) for k in (1, 2))
    _, moved = controller.step(state.adapt(), then, desired, 1e-3)
    assert moved.adapting and (moved.a_d != state.a_d).any() and (moved.a_k != state.a_k).any()
    rested = controller.step(moved.adapt(False), later, desired, 1e-3)[1]
    assert np.array_equal(rested.a_d, moved.a_d) and np.array_equal(rested.a_k, moved.a_k)


@pytest.mark.parametrize("mode", ["sampled", "continuous"])
def test_a_run_with_adaptation_disabled_equals_one_without_adaptation(mode):
    robot = catalogue_robot("planar_2r")
    path, torques = motion_at_home(robot), []
    for adaptation in ("natural", "none"):
        controller = pa.make_controller(wrong(robot), adaptation=adaptation)
        plant = pa.plants.PinocchioPlant(robot)
        state = controller.init(plant.measure(), adapting=adaptation == "none")
        run = pa.simulation.run_continuous if mode == "continuous" else pa.run
        stream = run(plant, controller, path, dt=1e-3, state=state)
        torques.append([next(stream).torque for _ in range(20)])
    assert np.array_equal(*torques)


def all_of(signals):
    """Return what signals hold, and what their inverse and filters hold."""
    own = [name for name in signals.__slots__ if name not in ("inverse", "filtered")]
    assert len(own) == 23
    filtered, inverse = signals.filtered, signals.inverse
    names = getattr(filtered, "_fields", None) or filtered.__slots__
    parts = *(getattr(filtered, name) for name in names), inverse.J, inverse.gram_inverse
    return (*(getattr(signals, name) for name in own), *parts)


OBSERVED = {
    "panda": ("panda", {}, {}),
    "planar": ("planar_2r", {}, {"unknown": pa.Unknown(lengths=True), "adaptation": "projected"}),
    "joints": ("ur5", {"task": "joint"}, {"law": "slotine-li"}),
    "predicted": ("panda", {}, {"adaptation": "natural-composite"}),
    "all of the joints": (
        "ur5",
        {},
        {"unknown": pa.Unknown(friction=True, armature=True), "law": JACOBIAN},
    ),
}


@pytest.mark.parametrize(("name", "task", "options"), OBSERVED.values(), ids=OBSERVED.keys())
def test_signals_do_not_change_when_another_instant_is_observed(name, task, options):
    robot = catalogue_robot(name, **task)
    controller = pa.make_controller(wrong(robot), **options)
    samples = record(robot, controller, motion_at_home(robot))
    first = controller.init(samples[0][0])
    state = replay(controller, samples)[1]
    signals = controller.observe(first, *samples[0])
    before = snapshot(all_of(signals))
    later = controller.observe(state, *samples[-1])
    assert unchanged(all_of(signals), before)
    assert not np.array_equal(later.dx, signals.dx) and not np.array_equal(later.q, signals.q)


def test_signals_can_be_copied():
    robot = catalogue_robot("ur5")
    controller = pa.make_controller(robot, law="adaptive-inverse-dynamics")
    samples = record(robot, controller, motion_at_home(robot), 1)
    signals = controller.observe(controller.init(samples[0][0]), *samples[0])
    before = snapshot(all_of(signals))
    assert type(signals) is pa.laws.Signals and not hasattr(signals, "__dict__")
    pickled = pickle.loads(pickle.dumps(signals))
    for alike in (copy.copy(signals), copy.deepcopy(signals), pickled, signals):
        assert type(alike) is pa.laws.Signals and unchanged(all_of(alike), before)
    other = signals.replaced(dx=2.0 * signals.dx)
    assert type(other) is pa.laws.Signals and other.q is signals.q
    assert (other.dx == 2.0 * signals.dx).all() and unchanged(all_of(signals), before)


def test_signals_do_not_share_the_callers_buffers():
    robot = catalogue_robot("ur5")
    controller = pa.make_controller(robot, adaptation="natural")
    (measurement, desired), *_ = record(robot, controller, motion_at_home(robot), 1)
    measurement, desired = (
        type(each)(*(np.array(part) if isinstance(part, np.ndarray) else part for part in each))
        for each in (measurement, desired)
    )
    signals = controller.observe(controller.init(measurement), measurement, desired)
    before = snapshot(all_of(signals))
    for buffer in (*measurement[1:4], *desired):
        buffer += 1.0
    assert unchanged(all_of(signals), before)


# --- what they must not return ---


class Plain(pa.laws.AdaptiveJacobian):
    """A law of a user's own, one part of whose command is something else."""

    def command(self, s, model):
        command = super().command(s, model)
        part, value = self.spoilt
        owner = command.drives.dynamic if part in Drive.__slots__ else command
        setattr(owner, part, value)
        return command if part != "all" else value


class Idle(pa.adaptation.Frozen):
    """An adaptation of a user's own that returns something else."""

    def step(self, estimate, drive, dt):
        return self.spoilt


WRONG_COMMANDS = {
    "torque": [
        None,
        0.0,
        [0.0, 0.0],
        np.zeros(3),
        np.zeros((2, 1)),
        np.zeros(2, int),
        np.full(2, np.nan),
    ],
    "feedthrough": [np.zeros(2), np.full((2, 2), np.inf), "none"],
    "drives": [None, ()],
    "gradient": [None, np.zeros(4), np.zeros((26, 1)), np.full(26, np.nan)],
    "Y": [None, np.zeros((2, 5))],
    "e": [np.zeros(3), 1.0],
}


@pytest.fixture(scope="module")
def planar():
    robot = pa.load("planar_2r")
    made = pa.make_controller(robot, law=JACOBIAN, adaptation="natural")
    return robot, made, pa.plants.PinocchioPlant(robot).measure()


@pytest.mark.parametrize("part", WRONG_COMMANDS)
def test_a_law_that_returns_something_else_is_refused_at_the_first_sample(part, planar):
    robot, made, first = planar
    gains = {name: getattr(made.law, name) for name in ("K_v", "K_P", "alpha", "R_k", "lambda_")}
    law = Plain(robot.task, made.law.posture, **gains)
    controller = pa.Controller(
        law,
        made.kinematics,
        made.dynamics,
        adaptation_k=made.adaptation_k,
        adaptation_d=made.adaptation_d,
    )
    for value in WRONG_COMMANDS[part]:
        object.__setattr__(law, "spoilt", (part, value))
        with pytest.raises(pa.InputError, match=rf"the law's (drives.dynamic\.)?{part}: "):
            controller.init(first)
    object.__setattr__(law, "spoilt", ("feedthrough", None))
    assert controller.init(first).t == first.t


@pytest.mark.parametrize(
    "value",
    [None, np.zeros(26), Estimate([0.0] * 26), Estimate(np.zeros(3)), Estimate(np.zeros(26, int))],
    ids=["None", "array", "list", "size", "integers"],
)
def test_an_adaptation_that_returns_something_else_is_refused_at_the_first_sample(value, planar):
    _, made, first = planar
    idle = Idle()
    idle.spoilt = value
    controller = pa.Controller(
        made.law,
        made.kinematics,
        made.dynamics,
        adaptation_k=made.adaptation_k,
        adaptation_d=idle,
    )
    with pytest.raises(pa.InputError, match="the dynamic adaptation's estimate"):
        controller.init(first)
