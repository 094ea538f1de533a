"""Copies of controllers and states: to the bit what they are copies of, in any process."""

import copy
import pickle
import threading
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from types import SimpleNamespace

import numpy as np
import pytest

import pinadapt as pa
from tests.support.chains import catalogue_robot
from tests.support.loops import motion_at_home, with_tool_and_load
from tests.support.paper import BASIS, CIRCLE, LMI
from tests.support.replays import record, replay
from tests.support.snapshots import snapshot, unchanged


def lengths(robot):
    return pa.Unknown(tool=False, lengths=robot.joint_names[1:])


def posing(robot):
    swing = pa.trajectories.Swing([0.0, 1.0, 1.0], 0.2, 2.0)
    path = pa.trajectories.PoseTrajectory(
        pa.trajectories.Circle(np.zeros(3), 0.05, 3.0, "yz"), swing
    )
    return path.starting_at(robot.position(robot.q0))


def swaying(robot):
    circle = pa.trajectories.Circle(np.zeros(3), 2e-3, 1.0)
    return pa.trajectories.PoseTrajectory(circle, None).starting_at(robot.position(robot.q0))


STANDS = {"base": "free", "contacts": ("FL_foot", "FR_foot", "RL_foot", "RR_foot")}
LAW_11 = "adaptive-inverse-dynamics"
CASES = {  # robot, its options, options of the controller, motion
    "panda, law (11)": ("panda", {}, {"law": LAW_11}, motion_at_home),
    "planar, basis": (
        "planar_2r",
        {},
        {"unknown": pa.Unknown(basis=BASIS, lmi=LMI)},
        lambda robot: CIRCLE,
    ),
    "ur5, lumped": ("ur5", {}, {"unknown": lengths, "adaptation": "projected"}, motion_at_home),
    "a1, standing": (
        "a1",
        STANDS,
        {"unknown": pa.Unknown(bodies="payload", friction=False, armature=False)},
        swaying,
    ),
    "kinova, pose": (
        "kinova",
        {"task": "pose"},
        {"law": "adaptive-jacobian", "unknown": pa.Unknown(friction=True, armature=True)},
        posing,
    ),
}


@pytest.fixture(params=CASES.values(), ids=CASES.keys(), scope="module")
def loop(request):
    """Return a controller, its samples, and the torques and the state that they led to."""
    name, loading, options, motion = request.param
    robot = catalogue_robot(name, **loading)
    options = {key: value(robot) if callable(value) else value for key, value in options.items()}
    controller = pa.make_controller(robot.changed(inertial_scale=0.8), **options)
    samples = record(with_tool_and_load(robot), controller, motion(robot))
    return controller, samples, *replay(controller, samples)


def from_read_only_memory(controller):
    """Return a copy whose arrays, as pickled, cannot be written, as those of joblib's workers."""
    buffers = []
    data = pickle.dumps(controller, protocol=5, buffer_callback=buffers.append)
    return pickle.loads(data, buffers=[bytes(buffer.raw()) for buffer in buffers])


@pytest.fixture(scope="module")
def pool():
    """Return one new process."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        yield pool


def test_a_copy_gives_the_same_torques_and_shares_no_scratch(loop):
    """Both step in turn, the original from other estimates."""
    controller, samples, torques, state = loop
    again, end = replay(copy.deepcopy(controller), samples)
    assert again.tobytes() == torques.tobytes() and unchanged(end, snapshot(state))
    other = from_read_only_memory(controller)
    first = samples[0][0]
    own = controller.init(first, a_d=1.02 * controller.dynamics.initial)
    twin = other.init(first)
    for (measurement, desired), expected in zip(samples, torques, strict=True):
        differs, own = controller.step(own, measurement, desired, 1e-3)
        torque, twin = other.step(twin, measurement, desired, 1e-3)
        assert torque.tobytes() == expected.tobytes() != differs.tobytes()


def test_another_process_gives_the_same_torques(loop, pool):
    controller, samples, torques, state = loop
    again, end = pool.submit(replay, controller, samples).result(timeout=100)
    assert again.tobytes() == torques.tobytes()
    assert unchanged(end, snapshot(state))


def test_a_second_thread_gets_an_error_never_a_wrong_torque(monkeypatch):
    """It comes while the first is between the models and the law."""
    ur5 = catalogue_robot("ur5")
    controller = pa.make_controller(ur5, adaptation="natural")
    plant = pa.plants.PinocchioPlant(ur5)
    samples = [plant.measurement(ur5.q0 + shift, np.zeros(6)) for shift in (0.1, -0.2)]
    states = [controller.init(sample) for sample in samples]
    desired = [pa.Desired(sample.x + 0.01, np.zeros(3), np.zeros(3)) for sample in samples]

    def torque(k):
        return controller.step(states[k], samples[k], desired[k], 1e-3)[0]

    signals = controller.observe(states[1], samples[1], desired[1])
    answer = controller.respond(states[1], signals)[0]
    alone = torque(0)
    law = controller.law
    refused = []
    assert np.array_equal(controller.respond(states[1], signals)[0], answer)  # after another state

    def second():
        for use in (
            lambda: torque(1),
            lambda: controller.observe(states[1], samples[1], desired[1]),
            lambda: controller.command(states[1], samples[1], desired[1]),
            lambda: controller.respond(states[1], signals),
            lambda: controller.limited(5.0).init(samples[1]),
        ):
            with pytest.raises(pa.InputError, match="another thread"):
                use()
            refused.append(use)

    def command(s, model):
        thread = threading.Thread(target=second)
        thread.start()
        thread.join()
        return law.command(s, model)

    monkeypatch.setattr(controller, "law", SimpleNamespace(command=command))
    assert np.array_equal(torque(0), alone) and len(refused) == 5
