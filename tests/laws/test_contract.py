"""Properties of every registered law, on arms and on a chain with a slide and a wheel.

The same tests for all: dV/dt is that of the proof; the error obeys the nominal dynamics where the
model is exact; any finite measurement gives finite numbers or a refusal. The order in which
parameters are named does not matter.
"""

from functools import cache
from itertools import islice

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import pinadapt as pa
from pinadapt.laws.acceleration_law import AccelerationLaw
from tests.support.chains import robot_of
from tests.support.differences import sampled_derivative
from tests.support.loops import circle_beside, energy_along, motion_at_home, with_tool_and_load

pytestmark = pytest.mark.slow

# As many joints as coordinates, more of them, and a chain with a slide and a wheel.
ROBOTS = ["planar_2r", "panda", "mixed"]
PAIRS = [(law, name) for law in pa.laws.LAWS for name in ROBOTS]
STEP = 1e-4  # [s] of the continuous loops

# While V is tested, the hypotheses must hold that adaptation can destroy: M_hat invertible, and
# M + M_0 - M_hat for the laws with a fixed M_0 under the ideal acceleration. Hence low rates.
RATES = {"adaptive-inverse-dynamics-improved": 0.05, "craig": 0.01, "spong-ortega": 0.01}


def joint_space(robot):
    return isinstance(robot.task, pa.tasks.JointTask)


def real(robot):
    """Return the true robot: with a load, and a tool where the task shows it."""
    if robot.task.size == 3:
        return with_tool_and_load(robot)
    return robot.changed(payload=pa.Payload(1.0, [0.01, 0.0, 0.05]), inertial_scale=1.1)


def beside(robot, law):
    """Return a motion at speed, or a set point for laws that only take one, beside home."""
    if pa.laws.LAWS[law].set_point:
        return pa.trajectories.Hold(robot.position(robot.q0) + 0.02).as_given()
    if joint_space(robot):
        return pa.trajectories.Sinusoid(
            robot.home_angles + 0.05, 0.3, np.linspace(2.0, 3.0, robot.model.nv)
        ).as_given()
    if robot.task.size == 3:
        return circle_beside(robot, "xy" if robot.name == "scara" else "yz")
    path = pa.trajectories.Circle(np.zeros(2), 0.05, 2.0)
    return path.starting_at(robot.position(robot.q0) + np.array([0.01, -0.02])).as_given()


def at_home(robot, law):
    """Return a motion, or a set point, that begins at home."""
    if pa.laws.LAWS[law].set_point:
        return pa.trajectories.Hold(robot.position(robot.q0))
    return motion_at_home(robot)


def controller_of(law, nominal, unknown=None, **options):
    words = pa.Unknown(friction=False, armature=False, **(unknown or {}))
    return pa.make_controller(nominal, law=law, unknown=words, **options)


def unlimited(controller):
    return controller.limited(None)


@pytest.mark.parametrize(("law", "name"), PAIRS)
def test_dv_dt_is_what_the_proof_says(law, name):
    robot = robot_of(law, name)
    true = real(robot)
    rates = {}
    if pa.laws.LAWS[law].adapts:
        rates = {"gamma_d": RATES.get(law, 1.0 if joint_space(robot) else 5.0)}
    believed = robot.changed(inertial_scale=0.8) if pa.laws.LAWS[law].adapts else true
    controller = controller_of(law, believed, **rates)
    # what follows the filtered regressor rises from zero within a few samples
    rising = 10 if controller.adaptation_d.torque_bandwidth else 0
    energy = energy_along(true, controller, beside(true, law), seconds=0.008)
    energy.check(after=rising)


def commanded_acceleration(law, s, a, Jdot_v):
    """Of laws that command an acceleration: ddx + K_v d(dx) + K_P dx, zero."""
    dxd = s.J @ s.v - s.xd_d + (0.0 if s.delta is None else s.delta)
    return s.J @ a + Jdot_v - s.xdd_d + law.K_v @ dxd + law.K_P @ s.dx


def task_feedback(law, s, error):
    """Of the adaptive Jacobian law: the torque of its feedback."""
    null = s.inverse.null(error)
    damping = s.inverse.null(law.posture.damping * null) if null.any() else 0.0
    return s.J.T @ (law.K_v @ (s.J @ s.v - s.xd_d) + law.K_P @ s.dx) + damping


def joint_feedback(law, s, error):
    """Of the separation law: the torque of its feedback."""
    return law.K_D(s.q, s.a_d) @ error


def spring_and_brake(law, s, error):
    """Of the laws for a set point: the torque of their feedback."""
    return s.J.T @ law.K_P @ law.saturation.of(s.dx) + law.brake(s.v)


NOMINAL = {
    pa.laws.AdaptiveJacobian: task_feedback,
    pa.laws.Separation: joint_feedback,
    pa.laws.ApproximateJacobian: spring_and_brake,
}


def coriolis(robot, q, u, w):
    """Return C(q, u) w, by polarisation of the inverse dynamics without gravity."""
    model = robot.model.copy()
    model.gravity.linear, model.armature = np.zeros(3), np.zeros(model.nv)
    data = model.createData()
    rest = np.zeros(model.nv)
    both, one, other = (pin.rnea(model, data, q, v, rest) for v in (u + w, u, w))
    return 0.5 * (both - one - other)


@pytest.mark.parametrize(("law", "name"), PAIRS)
def test_an_exact_model_gives_the_nominal_error_dynamics(law, name):
    """Accelerations as commanded, or M ds/dt + C s + the torque of the feedback = 0.

    Without a motion to follow s is the joint velocity.
    """
    true = real(robot_of(law, name))
    plant = pa.plants.PinocchioPlant(true)
    controller = unlimited(controller_of(law, true, adaptation="none"))
    path = beside(true, law)
    stream = pa.simulation.run_continuous(plant, controller, path, dt=STEP, ideal_acceleration=True)
    errors = []
    torques = []
    sizes = []
    for sample in islice(stream, 12):
        s, command = controller.command(sample.state, sample.measurement, sample.desired)
        q = s.q
        v = s.v
        a = plant.acceleration_at(q, v, command.torque, command.feedthrough)
        if isinstance(controller.law, AccelerationLaw):
            missing = commanded_acceleration(controller.law, s, a, s.Jdot_v)
            assert np.abs(missing).max() <= 1e-9 * (1.0 + np.abs(s.J @ a).max())
            continue
        error = v
        if not controller.law.set_point:
            error = controller.respond(sample.state, s.replaced(a=a))[1].dynamic.e
        kinds = (f for kind, f in NOMINAL.items() if isinstance(controller.law, kind))
        feedback = next(kinds, None)
        assert feedback is not None, f"NOMINAL lacks the feedback of {type(controller.law)}"
        errors.append(error)
        torques.append(coriolis(true, q, v, error) + feedback(controller.law, s, error))
        sizes.append(plant.mass_matrix(q))
    if errors:
        rates = sampled_derivative(np.array(errors), STEP)
        inertial = np.einsum("kij,kj->ki", np.array(sizes)[2:-2], rates)
        missing = inertial + np.array(torques)[2:-2]
        assert np.abs(missing).max() <= 1e-5 * np.abs(inertial).max()


def test_the_order_in_which_parameters_are_named_does_not_matter():
    law = "separation"
    runs = []
    robot = robot_of(law, "mixed")
    for flip in (1, -1):
        joints = robot.joint_names[-2:][::flip]
        tools = ["tool", "base"][::flip]
        unknown = {"tool": False, "translations": tools, "bodies": joints}
        controller = controller_of(law, robot, unknown)
        run = pa.simulate(real(robot), controller, at_home(robot, law), duration=0.02)
        names = [*controller.dynamics.names, *controller.kinematics.names]
        runs.append((run.tau, np.hstack([run.a_d, run.a_k])[:, np.argsort(names)]))
    for one, other in zip(*runs, strict=True):
        assert np.allclose(one, other, rtol=1e-9, atol=1e-9 * np.abs(one).max())


def finite(*arrays):
    return all(np.isfinite(array).all() for array in arrays if array is not None)


@cache
def prepared(law, name):
    """Return a law's controller of an arm, its robot and its motion, made once."""
    robot = robot_of(law, name)
    return pa.make_controller(robot, law=law), robot, at_home(robot, law)


@pytest.mark.parametrize("law", pa.laws.LAWS)
@settings(max_examples=12, deadline=None, derandomize=True)
@given(
    name=st.sampled_from(["panda", "mixed"]),
    seed=st.integers(0, 2**31),
    sizes=st.tuples(*[st.sampled_from([0.0, 1e-300, 1e-6, 1.0, 1e3, 1e12, 1e160, 1e308])] * 5),
)
@example(name="panda", seed=0, sizes=(1.0, 0.0, 1.0, 0.0, 0.0))
@example(name="panda", seed=150, sizes=(1e308, 0.0, 0.0, 0.0, 0.0))
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_any_finite_measurement_gives_finite_numbers_or_a_refusal(law, name, seed, sizes):
    """Of q, v, x, xd and a of any size; after a refusal the state is as good as before."""
    controller, robot, path = prepared(law, name)
    rng = np.random.default_rng(seed)
    n = robot.model.nv
    home = pa.plants.PinocchioPlant(robot).measure()
    state = controller.init(home)
    q, v, x, xd, a = sizes
    moved = pin.integrate(robot.model, robot.q0, q * rng.uniform(-1.0, 1.0, n))
    parts = {"v": v * rng.standard_normal(n), "a": a * rng.standard_normal(n)}
    if home.x is not None:
        parts["x"] = home.x + x * rng.standard_normal(home.x.size)
    if home.xd is not None:
        parts["xd"] = xd * rng.standard_normal(home.xd.size)
    strange = home._replace(t=1e-3, q=moved, **parts)
    try:
        torque, after = controller.step(state, strange, path.at(1e-3), 1e-3)
        assert finite(torque, after.a_d, after.a_k)
    except pa.PinadaptError:
        pass
    torque, after = controller.step(state, home._replace(t=1e-3), path.at(1e-3), 1e-3)
    assert finite(torque, after.a_d, after.a_k)
