"""A load and a URDF from an exciting motion, with friction, encoders and torque noise."""

from functools import cache

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.scenario.scenario import Scenario
from tests.support.paths import ROOT

pytestmark = pytest.mark.slow

FILES = {
    "panda": ROOT / "robots" / "panda" / "excited_load.toml",
    "ur10": ROOT / "robots" / "ur10" / "excited_load.toml",
}
COM = np.array([0.02, -0.01, 0.05])
OFF = 0.03  # of the arm's inertias


@cache
def run(name, *settings):
    """Return ten seconds of the motion in a scenario, at a period of 6 ms."""
    natural = "controller.adaptation=natural"
    return Scenario.read(FILES[name], ["controller.dt=6e-3", natural, *settings]).run()


def off_arm():
    """Return a setting: an arm whose bodies are off by some per cent."""
    rng = np.random.default_rng(4)
    arm = pa.load("panda")
    scales = ", ".join(f"{j} = {1.0 + OFF * rng.standard_normal():.4f}" for j in arm.joint_names)
    return f"truth.inertial_scale={{{scales}}}"


def misses(load, mass):
    """Return the errors of mass [kg] and centre [mm], and their stated uncertainties."""
    off = np.array([load.mass - mass, *1e3 * (load.com - COM)])
    return off, np.array([load.mass_known_to, *1e3 * load.com_known_to])


def test_the_load_is_known_to_two_per_cent_and_two_millimetres():
    mass = 3.0
    off, known = misses(run("ur10", "simulation.seed=1").payload(refined=True), mass)
    assert abs(off[0]) < 0.02 * mass and np.abs(off[1:]).max() < 2.0
    assert (np.abs(off) < 3.0 * known).all()  # see docs/learned.md for how often within two
    assert known[0] < 0.01 * mass and known[1:].max() < 1.0


def test_errors_of_the_arm_need_a_prior_or_a_run_without_load():
    loaded = run("panda", off_arm())
    empty = run("panda", off_arm(), "truth.payload={mass = 0.0}", "simulation.seed=1")
    off, known = misses(loaded.payload(refined=True), 1.5)  # the data say that the arm is off
    assert (np.abs(off) < 3.0 * known).all() and known[0] > 0.02
    empty_load = empty.payload(refined=True)
    assert abs(empty_load.mass) < 1.1 * empty_load.mass_known_to
    off, known = misses(loaded.payload(refined=True, arm=OFF), 1.5)
    assert (np.abs(off) < 3.0 * known).all() and known[0] > 0.02
    off, known = misses(loaded.payload(refined=True, empty=empty), 1.5)
    assert (np.abs(off) < 3.0 * known).all()
    assert abs(off[0]) < 0.02 * 1.5 and np.abs(off[1:]).max() < 2.0
