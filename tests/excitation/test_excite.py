"""Exciting motions: within all limits, of larger information gain than others, reproducible."""

from functools import cache
from itertools import combinations

import coal
import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa
from pinadapt.cli.command_line import main
from pinadapt.description.chain import configuration_from_angles, position_limits, velocity_limits
from pinadapt.excitation.allowance import Allowance, Shapes
from pinadapt.excitation.exciting_motion import RestToRest, _Search
from pinadapt.models.joint_effects import ALL
from pinadapt.scenario.scenario import Scenario
from pinadapt.tuning.unknowns import nominal_dynamics
from tests.support.chains import catalogue_robot, random_robot

pytestmark = pytest.mark.slow

HARMONICS = {"scara": 2, "planar_2r": 3}  # that excite all that is identifiable
ROBOTS = list(HARMONICS)


@cache
def excited(name):
    """Return a short motion that excites the load of a robot, from a search of 25 steps."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("pinadapt.excitation.exciting_motion._ITERATIONS", 15)
        return pa.excite(
            catalogue_robot(name),
            unknown=pa.Unknown(bodies="payload"),
            duration=6.0,
            harmonics=HARMONICS[name],
        )


@pytest.fixture
def short_search(monkeypatch):
    """Let a search end early, where the motion need not be the best one."""
    monkeypatch.setattr("pinadapt.excitation.exciting_motion._STARTS", 4)
    monkeypatch.setattr("pinadapt.excitation.exciting_motion._ITERATIONS", 5)


def search(name):
    """Return a search for motions of a robot, and some of its coefficients."""
    robot = catalogue_robot(name)
    dynamics = nominal_dynamics(robot, pa.Unknown(bodies="payload"), ALL)
    basis = RestToRest(HARMONICS[name], 6.0, 16 * HARMONICS[name])
    found = _Search(dynamics, Allowance(robot, None, None), basis)
    theta = np.random.default_rng(1).standard_normal((robot.model.nv, basis.size))
    return found, found.inside(theta)


@pytest.mark.parametrize("name", ROBOTS)
def test_it_begins_and_ends_at_home_at_rest_and_keeps_the_limits_in_between(name):
    robot = catalogue_robot(name)
    motion = excited(name)
    for t in (0.0, motion.trajectory.period):
        x, xd, xdd = motion.trajectory.at(t)
        assert np.allclose(x, robot.home_angles, atol=1e-12)
        assert np.allclose(xd, 0.0, atol=1e-12) and np.allclose(xdd, 0.0, atol=1e-11)
    lower, upper = position_limits(robot.model)
    loaded = robot.changed(payload=pa.Payload(motion.limits.load)).model
    data = loaded.createData()
    most = np.zeros(robot.model.nv)
    for t in np.linspace(0.0, 6.0, 1501):
        x, v, a = motion.trajectory.at(t)
        assert (x > lower).all() and (x < upper).all()
        assert (np.abs(v) < 0.81 * velocity_limits(robot.model)).all()
        q = configuration_from_angles(loaded, x)
        most = np.maximum(most, np.abs(pin.rnea(loaded, data, q, v, a)))
    assert (most < 0.81 * robot.model.effortLimit).all()
    assert (most / robot.model.effortLimit <= motion.limits.effort + 1e-3).all()
    assert motion.limits.velocity.max() <= 0.8 + 1e-9 and motion.limits.effort.max() <= 0.8


@pytest.mark.parametrize("name", ROBOTS)
def test_it_excites_all_identifiable_combinations_and_gains_more_than_random_motions(name):
    motion = excited(name)
    assert motion.information.rank == motion.identifiable
    found, theta = search(name)
    rng = np.random.default_rng(5)
    others = [
        found.gain(found.states(found.inside(rng.standard_normal(theta.shape))))[0]
        for _ in range(5)
    ]
    assert motion.information_gain > np.max(others) + 1.0  # nat


@pytest.mark.usefixtures("short_search")
def test_any_chain_can_be_excited():
    """Continuous and prismatic joints, arbitrary axes, inclined gravity, no limits."""
    robot = random_robot(11, 4)
    motion = pa.excite(robot, duration=4.0, excursion=0.4)
    path = motion.trajectory.positions(np.linspace(0.0, 4.0, 200)) - robot.home_angles
    assert np.abs(path).max() <= 0.4 + 1e-6
    assert motion.information.rank == motion.identifiable > 10


@pytest.mark.usefixtures("short_search")
def test_the_command_writes_the_printed_motion_as_a_scenario(tmp_path, capsys):
    file = tmp_path / "out" / "excited.toml"
    arguments = [
        "excite",
        "planar_2r",
        "--unknown",
        "payload",
        "--duration",
        "4",
        "--out",
        str(file),
    ]
    assert main(arguments) == 0
    assert f"pinadapt run {file}" in capsys.readouterr().out
    scenario = Scenario.read(file)
    assert scenario.duration == 4.0
    motion = pa.excite(
        catalogue_robot("planar_2r"), unknown=pa.Unknown(bodies="payload"), duration=4.0
    )
    written = scenario.trajectory.at(1.3)
    found = motion.trajectory.at(1.3)
    assert np.allclose(written.x_d, found.x_d, atol=1e-5)
    assert scenario.controller.dynamics.names == motion.information.names
    assert main(arguments) == 2 and "exists already" in capsys.readouterr().err


# --- nothing touches ---


def joints_of(motion, count=400):
    """Return the configurations of a motion of joints that are all limited."""
    return np.array([motion.trajectory.at(t).x_d for t in np.linspace(0.0, motion.duration, count)])


def test_bodies_and_floor_stay_apart(monkeypatch):
    """Distances of the meshes; without shapes the search, which ends early, finds a collision."""
    monkeypatch.setattr("pinadapt.excitation.exciting_motion._STARTS", 4)
    monkeypatch.setattr("pinadapt.excitation.exciting_motion._ITERATIONS", 8)
    robot = catalogue_robot("ur5")
    options = {"unknown": "bodies", "duration": 6.0, "harmonics": 2, "seed": 2}
    wide = {"excursion": 2.8, "progress": False}
    free = pa.excite(robot.undrawn(), **options, **wide)
    kept = pa.excite(robot, floor=-0.05, **options, **wide)
    geometry, links = robot.drawn.solids()
    joints = [shape.parentJoint for shape in geometry.geometryObjects]
    for i, j in combinations(range(len(links)), 2):
        if abs(joints[i] - joints[j]) > 1:
            geometry.addCollisionPair(pin.CollisionPair(i, j))
    data = robot.model.createData()
    found = geometry.createData()

    def closest(motion):
        distances = []
        for q in joints_of(motion, 50):
            pin.computeDistances(robot.model, data, geometry, found, q)
            distances.append(min(result.min_distance for result in found.distanceResults))
        return min(distances)

    assert Shapes.of(robot, None, None).distances(joints_of(free)).min() < -0.01
    assert closest(kept) > 5e-3
    assert kept.limits.apart > 5e-3 and np.isinf(free.limits.apart)
    heights = []
    for q in joints_of(kept, 100):
        pin.updateGeometryPlacements(robot.model, data, geometry, found, q)
        for shape, M, joint in zip(geometry.geometryObjects, found.oMg, joints, strict=True):
            if joint > 1 and isinstance(shape.geometry, coal.BVHModelBase):
                corners = np.array(shape.geometry.vertices())
                heights.append((corners @ M.rotation.T + M.translation)[:, 2].min())
    assert min(heights) > -0.05
    assert kept.information.rank == kept.identifiable
    assert kept.information_gain > 0.8 * free.information_gain
