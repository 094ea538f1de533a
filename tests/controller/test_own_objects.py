"""A user's own laws and adaptations, and ours given as objects, in place of their names."""

import re
from dataclasses import replace

import numpy as np
import pytest

import pinadapt as pa
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


def test_the_law_of_the_guide_reaches_its_set_point(guide):
    assert guide["rollout"].diverged is None
    assert np.degrees(np.abs(guide["rollout"].error[-1])).max() < 0.1


def test_the_closed_loop_of_the_guide_obeys_its_proof(guide):
    controller = pa.make_controller(guide["robot"], law=guide["law"], gamma_d=1.0)
    path = pa.trajectories.Hold(guide["robot"].home_angles + 0.2)
    energy = energy_along(guide["true"], controller, path, seconds=0.006)
    assert energy.mismatch() <= 1e-6 and np.abs(energy.rate).max() > 1e-4


@pytest.mark.parametrize(
    "made",  # nothing, or integers, which a kernel would read as floats
    [None, pa.laws.Command(np.full(6, 900), pa.adaptation.Drives.none(60, 0))],
)
def test_a_command_that_does_not_fit_is_refused_by_the_name_of_its_law(guide, made):
    law = replace(guide["law"])
    object.__setattr__(law, "command", lambda s, model: made)
    controller = pa.make_controller(guide["robot"], law=law)
    with pytest.raises(pa.InputError, match=r"AdaptiveGravity\.command: .*'torque': \(6,\)"):
        pa.simulate(guide["robot"], controller, pa.trajectories.Hold(), duration=0.01)


# --- our own as objects ---


def wrong(robot):
    return robot.changed(inertial_scale=0.8)


@pytest.mark.parametrize("kind", ["natural", "projected"])
def test_law_and_adaptation_as_objects_are_those_by_name(kind):
    robot = catalogue_robot("panda")
    own = {"alpha": 5.0, "R_k": 30.0, "lambda_": 12.0}
    posture = pa.laws.Posture(wrong(robot), frequency=6.0)
    law = pa.laws.AdaptiveJacobian(robot.task, posture, K_v=90.0, K_P=800.0, **own)
    gains = {"Kv": 90.0, "Kp": 800.0, "posture": 6.0, **own}
    by_name = pa.make_controller(wrong(robot), law=JACOBIAN, adaptation=kind, **gains)
    by_object = pa.make_controller(
        wrong(robot),
        law=law,
        adaptation=by_name.adaptation_d,
        kinematic_adaptation=by_name.adaptation_k,
    )
    samples = record(with_tool_and_load(robot), by_name, motion_at_home(robot))
    (torques, state), (same, end) = (replay(each, samples) for each in (by_name, by_object))
    assert same.tobytes() == torques.tobytes() and unchanged(end, snapshot(state))
    assert by_object.law is law


# --- wrappers around any adaptation ---


def test_a_box_bounds_an_adaptation_of_a_users_own(guide):
    a = pa.models.BodyDynamics(catalogue_robot("ur5")).initial
    rng = np.random.default_rng(1)
    inner = guide["Normalised"](Gamma=1.0, T=0.1)
    low = a - 0.01 * np.abs(a) - 1e-3
    high = a + 0.01 * np.abs(a) + 1e-3
    boxed = pa.adaptation.BoxProjection(inner, low, high)
    free = inner.init(a)
    held = boxed.init(a)
    drive = along(1e-6 * rng.standard_normal(a.size))  # so short a step that no wall is met
    assert unchanged(boxed.step(held, drive, 1e-3), snapshot(inner.step(free, drive, 1e-3)))
    left = 0
    for _ in range(30):
        drive = along(30.0 * rng.standard_normal(a.size))
        free = inner.step(free, drive, 1e-2)
        held = boxed.step(held, drive, 1e-2)
        left += not ((low <= free.value) & (free.value <= high)).all()
        assert ((low <= held.value) & (held.value <= high)).all() and boxed.contains(held.value)
        assert unchanged((held.memory,), snapshot((free.memory,)))  # it remembers as before
    assert left > 0  # without the box it leaves
