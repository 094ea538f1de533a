"""The disturbance of a run: the torque that acts on the joints and is not in the model."""

import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa
from pinadapt.controller.controller import Controller
from tests.support.chains import catalogue_robot

pytestmark = pytest.mark.slow
DT, BEGIN = 2e-3, 2.0
LOAD = pa.Payload(1.0, [0.02, 0.0, 0.06])


def run(name, duration, engine="pinocchio", load=LOAD, **options):
    """Return a run whose load is learned."""
    robot = catalogue_robot(name)
    true = robot.changed(payload=load)
    controller = pa.make_controller(robot, dt=DT, **{"unknown": "payload", **options})
    return pa.simulate(
        true, controller, pa.reachable_circle(true), duration=duration, engine=engine
    )


def push_at(robot, q, force):
    """Return J^T F (n) of a force (3) on the tool."""
    place = robot.frame_id, pin.LOCAL_WORLD_ALIGNED
    J = pin.computeFrameJacobian(robot.model, robot.model.createData(), q, *place)[:3]
    return J.T @ force


def test_a_push_on_a_learned_robot_is_its_joint_torque():
    """Sideways, as no load pushes; 0.2 s are six times the slower filter's time."""
    force = np.array([0.0, 20.0, 0.0])
    loaded = catalogue_robot("ur5").changed(payload=LOAD)

    class Pushed(pa.plants.PinocchioPlant):
        time = 0.0

        def step(self, torque, dt):
            pushed = self.time >= BEGIN - 0.5 * dt
            self.time += dt
            super().step(torque + pushed * push_at(loaded, self.measure().q, force), dt)

    rollout = run("ur5", BEGIN + 0.3, Pushed, unknown=None)  # else the load explains a part
    k = round(BEGIN / DT)
    assert np.linalg.norm(rollout.disturbance[k]) < 0.1
    for later in (0.2, 0.25):
        k = round((BEGIN + later) / DT)
        true = push_at(loaded, rollout.q[k], force)
        assert np.linalg.norm(rollout.disturbance[k] - true) < 0.1 * np.linalg.norm(true)


@pytest.mark.parametrize(
    ("name", "sensors"),
    [
        ("panda", pa.Sensors(encoder=2.0 * np.pi / 2**14)),
        ("ur5", pa.Sensors(noise={"v": 1e-2})),
    ],
    ids=["14 bit", "noise"],
)
def test_noise_explains_the_disturbance_of_a_known_robot(name, sensors, monkeypatch):
    """All joints together; one that hardly turns has no white noise of counts."""
    init = Controller.init
    monkeypatch.setattr(Controller, "init", lambda *a, **k: init(*a, **k).adapt(False))
    rollout = run(name, 1.7, load=None, sensors=sensors)
    later = rollout.t > 0.7
    of = rollout.evaluated().controller
    told = np.array([of.disturbance_noise(q, of.period) for q in rollout.q[later]])
    seen = rollout.disturbance[later]
    ratio = np.sqrt(np.mean(seen**2, axis=0) / np.mean(told**2, axis=0))
    assert np.exp(np.mean(np.log(ratio))) == pytest.approx(1.0, abs=0.2)
    assert ratio.min() > 0.7 and ratio.max() < 1.5


@pytest.mark.parametrize("told", [True, False])
def test_a_torque_that_was_not_given_is_a_disturbance_unless_the_state_is_told(told):
    """The motors give 2 N m less than what is asked, and the arm yields."""
    robot = catalogue_robot("panda")
    less = np.full(7, 2.0)
    controller = pa.make_controller(robot, dt=DT)
    plant = pa.plants.PinocchioPlant(robot)
    motion = pa.reachable_circle(robot)
    state = controller.init(plant.measure()).adapt(False)
    given = None
    for k in range(150):
        desired = motion.at(k * DT)
        state = state.gave(given) if told else state
        asked, state = controller.step(state, plant.measure()._replace(t=k * DT), desired, DT)
        given = asked - less
        plant.step(given, DT)
    expected = 0.0 if told else -2.0
    assert np.allclose(controller.disturbance(state), expected, atol=0.5)
