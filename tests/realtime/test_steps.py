"""A robot that crawls on the clock: its log, a stop with a foot in the air, and safe torques."""

from functools import cache

import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa
from pinadapt.realtime import CycleLog, PlantArm, Recorder
from pinadapt.realtime.recorder import Phase
from pinadapt.trajectories import Crawl, Hold
from tests.constraints.test_standing import FEET, TRUNK, standing
from tests.support.arms import Loop, forking

PERIOD = 2e-3
IN_THE_AIR = 0.7  # [s], of the first step; the path halts 0.15 s later
TRUE = pa.Payload(mass=6.0, com=(0.05, 0.02, 0.08))


@cache
def crawler():
    """Return a robot that stands, and its controller."""
    robot = standing("a1")
    return robot, pa.make_controller(robot, unknown=TRUNK, dt=PERIOD)


def feet(q):
    """Return where the feet are (4, 3) [m]."""
    model = crawler()[0].model
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    return np.array([data.oMf[model.getFrameId(foot)].translation for foot in FEET["a1"]])


@pytest.mark.slow
def test_a_crawl_on_the_clock_is_replayed_and_stops_with_a_foot_in_the_air(tmp_path):
    robot, controller = crawler()
    plant = pa.plants.MujocoPlant(robot.changed(payload=TRUE))
    crawl = Crawl(steps=1).on(robot)
    path = tmp_path / "run.mcap"
    with forking(), Recorder(path, controller) as recorder:
        loop = Loop(
            PlantArm(plant, PERIOD), "adapt", IN_THE_AIR, crawl, controller, recorder=recorder
        )
        ending = loop.ended()
    assert loop.phases == ["running", "holding", "damping", "stopped"] and not ending.failed
    (foot,) = np.flatnonzero(~ending.state.stands)
    there = feet(plant.measure().q)
    planned = crawl.footholds[0]
    assert there[foot, 2] > 0.02
    others = np.arange(4) != foot
    assert np.abs(there - planned)[others].max() < 1e-3
    assert np.abs(plant.measure().x - crawl.at(IN_THE_AIR).x_d).max() < 1e-3
    assert CycleLog.read(path).replay(controller).same


def test_a_new_motion_waits_until_all_feet_stand():
    robot, controller = crawler()
    arm = PlantArm(pa.plants.PinocchioPlant(robot), PERIOD)
    loop = Loop(arm, motion=Crawl().on(robot), of=controller).loop
    m = arm.read()
    lifted = np.zeros((4, 3))
    lifted[0] = np.nan
    loop._state = controller.init(m)._replace(footing=lifted)
    loop._enter(Phase.HOLDING, "commanded", commanded=True)
    loop._t += 1.0
    with pytest.raises(pa.InputError, match="a foot is in the air"):
        loop._command("reference", Hold.of(robot.task, m))
    loop._state = loop._state._replace(footing=np.zeros((4, 3)))
    loop._command("reference", Hold.of(robot.task, m))
    assert not loop._halted


def test_safe_torques_hold_a_foot_in_the_air_and_the_trunk_on_the_others():
    """Were all feet taken to stand, the leg in the air would fall by 0.24 rad."""
    robot, controller = crawler()
    plant = pa.plants.MujocoPlant(robot.changed(payload=TRUE))
    crawl = Crawl(steps=1).on(robot)
    *_, last = pa.run(plant, controller, crawl, dt=PERIOD, duration=0.8)
    _, state = controller.step(last.state, last.measurement, last.desired, PERIOD)
    assert state.stands.sum() == 3
    q = plant.measure().q
    for _ in range(200):
        torque, state = controller.safe(state, plant.measure())
        plant.step(torque, PERIOD)
    assert np.abs(plant.measure().q - q).max() < 0.005


def test_a_torque_beside_gravity_reaches_the_ground_by_the_feet():
    """That of a load nobody knows of: without it the trunk sinks by 17 mm."""
    robot, controller = crawler()
    true = robot.changed(payload=TRUE)
    q = robot.q0
    sunk = []
    known, found = (
        pin.computeGeneralizedGravity(one.model, one.model.createData(), q) for one in (robot, true)
    )
    for beside in (0.0, found - known):
        plant = pa.plants.MujocoPlant(true)
        state = controller.init(plant.measure())
        for _ in range(150):
            torque, state = controller.safe(state, plant.measure(), beside=beside)
            assert not torque[:6].any()
            plant.step(torque, PERIOD)
        sunk.append(abs(plant.measure().q[2] - q[2]))
    assert sunk[1] < 2e-4 < 2e-3 < sunk[0]
