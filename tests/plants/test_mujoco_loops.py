"""The shipped scenarios under the same controllers in both engines."""

import numpy as np
import pytest

from pinadapt.scenario.scenario import Scenario
from tests.support.paths import ROOT

pytest.importorskip("mujoco")  # pip install -e '.[dev]' brings it

ROBOTS = ROOT / "robots"
ENGINES = ("pinocchio", "mujoco")
SOONER = "events.changes=[{at=0.4, payload={mass=0.0}}, {at=0.7, payload={mass=3.0}}]"
TWO_MS = "controller.dt=0.002"
LASTING = ["simulation.duration=2.5", "trajectory.as_given=true", "controller.adaptation=natural"]
HALF = "truth.friction={viscous=1.0, coulomb=0.25}"

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore::UserWarning")]


def run(name, engine, *settings):
    """Return the rollout of a scenario."""
    rollout = Scenario.read(ROBOTS / name, [f'engine.plant="{engine}"', *settings]).run()
    assert rollout.diverged is None
    return rollout


def test_the_remaining_error_is_within_a_tenth_of_that_in_pinocchio():
    """The Panda's scenario has dry friction, here half of it, which the engines model differently.

    A memory would learn either model to micrometres, where they differ.
    """
    settings = [*LASTING, TWO_MS, HALF]
    ours, theirs = (run("panda/tool_and_load.toml", engine, *settings) for engine in ENGINES)
    one, other = (rollout.summary()["max_error_last"] for rollout in (ours, theirs))
    assert other < 0.3e-3 and np.isclose(one, other, rtol=0.1)


@pytest.mark.parametrize(
    ("name", "settings"), [("panda/load_changes.toml", [SOONER]), ("panda/pose.toml", [])]
)
def test_without_coulomb_friction_the_paths_agree_to_a_micrometre(name, settings):
    """For half a second, that is; small differences grow."""
    settings = ["simulation.duration=0.5", TWO_MS, *settings]
    ours, theirs = (run(name, engine, *settings) for engine in ENGINES)
    assert np.allclose(ours.x, theirs.x, rtol=0.0, atol=1e-6)
    assert np.linalg.norm(ours.error[:, :3], axis=1).max() > 2e-3
