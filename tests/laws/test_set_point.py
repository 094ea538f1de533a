"""Laws for a set point with a wrong Jacobian: their proofs, their bounds, what they refuse."""

import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa
from tests.support.chains import catalogue_robot, mixed_robot
from tests.support.loops import circle_at_home, energy_along

pytestmark = pytest.mark.slow

LAWS = [name for name, law in pa.laws.LAWS.items() if law.set_point]
BOUNDED, EXACT, ROUGH = "bounded-torque", "approximate-jacobian", "approximate-jacobian-gravity"
CHAINS = [("planar_2r", None), ("panda", "xyz"), ("mixed", "xyz")]
CASES = [*CHAINS, ("ur5", "pose"), ("mixed", "joint")]


def robot_of(name, task):
    if name != "mixed":
        return catalogue_robot(name, **({"task": task} if task else {}))
    return mixed_robot(task)


def unlike(robot):
    """Return the robot with half a kilogram, and a tool that the model lacks."""
    load = pa.Payload(0.5, [0.01, 0.0, 0.05], [0.01, 0.0, 0.01, 0.0, 0.0, 0.01])
    if isinstance(robot.task, pa.tasks.JointTask):
        return robot.changed(payload=load)
    return robot.changed(tool_translation=[0.02, -0.01, 0.04], payload=load)


def beside_home(robot):
    """Return a set point a little off home, turned for a pose."""
    x = robot.position(robot.q0)
    if isinstance(robot.task, pa.tasks.PoseTask):
        here = pa.trajectories.PoseTrajectory(pa.trajectories.Hold(x[:3]), x[3:])
        return here.shifted([0.02, 0.02, 0.02, 0.1, -0.2, 0.05])
    return pa.trajectories.Hold(x + 0.02)


# --- the proofs ---


@pytest.mark.parametrize(
    ("name", "task", "adaptation"),
    [*((*case, "natural") for case in CASES), ("panda", "xyz", "gradient")],
)
@pytest.mark.parametrize("law", [EXACT, BOUNDED])
def test_equality_along_the_trajectory(law, name, task, adaptation):
    robot = robot_of(name, task)
    true = unlike(robot)
    believed = robot.changed(inertial_scale=0.8)
    controller = pa.make_controller(believed, law=law, adaptation=adaptation)
    energy = energy_along(true, controller, beside_home(true), seconds=0.006)
    energy.check(within=1e-6)
    assert (energy.V > 0.0).all()


# --- at work ---


@pytest.mark.parametrize(("law", "name"), [(EXACT, "panda"), (BOUNDED, "scara")])
def test_the_set_point_is_reached(law, name):
    robot = catalogue_robot(name)
    true = unlike(robot)
    goal = pa.trajectories.Hold(true.position(true.q0) - 0.05)
    controller = pa.make_controller(robot.changed(inertial_scale=0.8), law=law, dt=4e-3)
    rollout = pa.simulate(true, controller, goal, duration=3.2)
    assert rollout.diverged is None and rollout.distance[-125:].max() < 5e-4
    assert (rollout.a_k == rollout.a_k[0]).all()  # the kinematics are not learned
    alone = pa.make_controller(
        robot.changed(inertial_scale=0.8), law=law, adaptation="none", dt=4e-3
    )
    unadapted = pa.simulate(true, alone, goal, duration=1.0)
    assert unadapted.distance[-25:].max() > 10.0 * rollout.distance[-125:].max()


# --- the bound ---


def near_gravity(true):
    """Return torques 15 % above what gravity may ask for anywhere, 3 N m where that is little."""
    model = true.model
    rng = np.random.default_rng(0)
    low = model.lowerPositionLimit
    high = model.upperPositionLimit
    asked = [
        np.abs(pin.computeGeneralizedGravity(model, model.createData(), rng.uniform(low, high)))
        for _ in range(2000)
    ]
    return np.maximum(1.15 * np.max(asked, axis=0), 3.0)


def test_bounds_near_gravity_are_kept_at_every_sample():
    robot = catalogue_robot("panda")
    true = unlike(robot)
    bound = near_gravity(true)
    controller = pa.make_controller(
        robot.changed(inertial_scale=0.8),
        law=BOUNDED,
        bound=bound,
        limits=pa.Limits(torque=False),
        dt=4e-3,
    )
    goal = pa.trajectories.Hold(true.position(true.q0) + np.array([-0.1, 0.1, -0.1])).as_given()
    rollout = pa.simulate(
        true, controller, goal, duration=10.0, engine=pa.Engine(torque_limits=False)
    )
    assert rollout.diverged is None and (np.abs(rollout.tau) <= bound).all()
    assert (np.abs(rollout.tau) / bound).max() > 0.8  # gravity comes near
    assert rollout.distance[-250:].max() < 1e-3 < 0.1 < rollout.distance[0]
    free = pa.make_controller(
        robot.changed(inertial_scale=0.8), law=EXACT, limits=pa.Limits(torque=False)
    )
    unbounded = pa.simulate(true, free, goal, duration=0.3, engine=pa.Engine(torque_limits=False))
    assert (np.abs(unbounded.tau) > bound).any()


@pytest.mark.parametrize(
    ("name", "task", "adaptation"),
    [
        ("panda", "xyz", "natural"),
        ("panda", "xyz", "natural-memory"),
        ("ur5", "pose", "natural"),
        ("mixed", "joint", "natural"),
    ],
)
def test_no_state_and_no_estimate_exceeds_the_bound(name, task, adaptation):
    robot = robot_of(name, task)
    rng = np.random.default_rng(1)
    controller = pa.make_controller(
        robot, law=BOUNDED, adaptation=adaptation, limits=pa.Limits(guards=False, torque=None)
    )
    law = controller.law
    n = robot.model.nv
    quantity = controller.init(pa.Measurement(0.0, robot.q0, np.zeros(n), robot.position(robot.q0)))
    for scale in (1e-2, 1.0, 1e3):
        for _ in range(40):
            q = pin.integrate(robot.model, robot.q0, rng.uniform(-3.0, 3.0, n))
            v = scale * rng.standard_normal(n)
            x = robot.position(q)
            x = robot.task.moved(x, np.minimum(scale, 3.0) * rng.standard_normal(robot.task.size))
            a_d = quantity.a_d * np.repeat(rng.uniform(0.2, 5.0, n), 10)
            state = quantity._replace(dynamic=quantity.dynamic.with_value(a_d))
            desired = beside_home(robot).at(0.0)
            at = pa.Measurement(0.0, q, v, x)
            signals, command = controller.command(state, at, desired)
            assert (np.abs(command.torque) <= law.bound).all()
            rest = np.zeros(n)
            controller.dynamics.load(signals.a_d)
            gravity = controller.dynamics.torque(q, rest, rest)
            pull = signals.J.T @ law.K_P @ law.saturation.of(signals.dx)
            brake = law.brake(v)
            assert (np.abs(pull) + np.abs(brake) <= law.bound - law.gravity + 1e-9).all()
            assert (np.abs(gravity) <= law.gravity * (1.0 + 1e-6)).all()


@pytest.mark.parametrize("kind", ["natural", "gradient", "least-squares"])
def test_the_projection_only_lowers_what_the_parameters_add_to_v(kind):
    robot = catalogue_robot("panda")
    rng = np.random.default_rng(2)
    believed = robot.changed(inertial_scale=1.2)
    bound = near_gravity(unlike(robot))
    controller = pa.make_controller(
        believed, law=BOUNDED, adaptation=kind, bound=bound, gravity=0.89 * bound
    )
    adaptation = controller.adaptation_d
    dynamics = controller.dynamics
    G = controller.law.gravity
    value = adaptation.init(dynamics.initial).value
    a = dynamics.value(robot)
    moved = 0
    rest = np.zeros(7)
    before = adaptation.storage(pa.adaptation.Estimate(value), a)
    low = robot.model.lowerPositionLimit
    high = robot.model.upperPositionLimit
    for _ in range(200):
        q = rng.uniform(low, high)
        kept = adaptation.project(pa.adaptation.Estimate(value), q)
        dynamics.load(kept)
        assert (np.abs(dynamics.torque(q, rest, rest)) <= G * (1.0 + 1e-6)).all()
        after = adaptation.storage(pa.adaptation.Estimate(kept), a)
        if kept is not value:
            assert after < before
            moved += 1
        value = kept
        before = after
    assert moved and adaptation.contains(value)


# --- what is refused ---


class Drift(pa.trajectories.Trajectory):
    """A motion of a user's own that never comes to rest, and does not say so."""

    def at(self, t):
        return pa.Desired(np.full(3, 0.4 + 0.01 * t), np.full(3, 0.01), np.zeros(3))


@pytest.mark.parametrize("law", LAWS)
def test_a_motion_that_never_rests_is_refused_before_anything_moves(law):
    robot = catalogue_robot("ur5")
    controller = pa.make_controller(robot, law=law)
    plant = pa.plants.PinocchioPlant(robot)
    for path in (circle_at_home(robot), Drift()):
        for start in (
            lambda path: pa.simulate(robot, controller, path, duration=0.1),
            lambda path: next(pa.run(plant, controller, path)),
            lambda path: next(pa.simulation.run_continuous(plant, controller, path, dt=1e-3)),
        ):
            with pytest.raises(pa.InputError, match=r"does not come to rest.*hold.*separation"):
                start(path)
    assert pa.trajectories.PoseTrajectory(Drift()).settles is None
