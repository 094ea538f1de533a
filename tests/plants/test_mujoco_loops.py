"""The shipped scenarios under the same controllers in both engines."""

from functools import cache

import numpy as np
import pytest

from pinadapt.description.chain import position_limits
from pinadapt.scenario.scenario import Scenario
from tests.support.paths import ROOT

pytest.importorskip("mujoco")  # pip install -e '.[dev]' brings it

ROBOTS = ROOT / "robots"
ENGINES = ("pinocchio", "mujoco")
SOONER = "events.changes=[{at=0.4, payload={mass=0.0}}, {at=0.7, payload={mass=3.0}}]"
SHORTER, MOVING = "simulation.duration=2.5", "trajectory.as_given=true"
TWO_MS = "controller.dt=0.002"
KINDS = {
    "panda/tool_and_load.toml": [TWO_MS, "controller.adaptation=natural"],
    "ur5/unknown_lengths.toml": [TWO_MS],
}
HALF = "truth.friction={viscous=1.0, coulomb=0.25}"
LINE = 'trajectory={kind="lissajous", amplitude=[0.0, 0.15, 0.0], cycles=[1, 1, 1], period=4.0}'

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore::UserWarning")]


@cache
def run(name, engine, *settings):
    """Return a scenario and its rollout, which several tests look at."""
    scenario = Scenario.read(ROBOTS / name, [f'engine.plant="{engine}"', *settings])
    rollout = scenario.run()
    assert rollout.diverged is None
    return scenario, rollout


@pytest.mark.parametrize("name", KINDS)
def test_the_remaining_error_is_within_a_tenth_of_that_in_pinocchio(name):
    """The Panda's scenario has dry friction, here half of it, which the engines model differently.

    A memory would learn either model to micrometres, where they differ.
    """
    settings = [SHORTER, MOVING, *KINDS[name], *([HALF] if "tool" in name else [])]
    ours, theirs = (run(name, engine, *settings)[1] for engine in ENGINES)
    one, other = (rollout.summary()["max_error_last"] for rollout in (ours, theirs))
    assert other < 0.3e-3 and np.isclose(one, other, rtol=0.1)
    assert ours.limits.exceeded == theirs.limits.exceeded


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("panda/load_changes.toml", [SOONER]),
        ("panda/pose.toml", []),
        ("ur5/unknown_lengths.toml", []),
    ],
)
def test_without_coulomb_friction_the_paths_agree_to_a_micrometre(name, settings):
    """For a second, that is; small differences grow."""
    settings = ["simulation.duration=1.0", TWO_MS, *settings]
    ours, theirs = (run(name, engine, *settings)[1] for engine in ENGINES)
    assert np.allclose(ours.x, theirs.x, rtol=0.0, atol=1e-6)
    assert np.linalg.norm(ours.error[:, :3], axis=1).max() > 2e-3


@pytest.mark.parametrize("name", KINDS)
def test_unknown_rotors_and_damping_are_tolerated(name):
    friction = f"truth.friction={{viscous=1.0, coulomb={0.5 if 'tool' in name else 0.0}}}"
    settings = ("simulation.duration=3.0", MOVING, "truth.armature=0.1", friction, *KINDS[name])
    _, rollout = run(name, "mujoco", *settings)
    assert rollout.summary()["max_error_last"] < 0.5e-3


def test_a_line_with_friction_stays_off_the_stops():
    settings = ("simulation.duration=4.4", "controller.dt=0.004", LINE)
    scenario, rollout = run("panda/tool_and_load.toml", "mujoco", *settings)
    lower, upper = position_limits(scenario.true.model)
    assert np.ptp(rollout.x[:, 1]) > 0.29
    assert np.minimum(rollout.q - lower, upper - rollout.q).min() > 0.5
    assert rollout.summary()["max_error_last"] < 1e-3
