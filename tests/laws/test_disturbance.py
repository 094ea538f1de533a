"""The prediction error of the torque in the feedback: its part of V, what it is, its sources."""

from itertools import islice

import numpy as np
import pytest

import pinadapt as pa
from tests.support.chains import catalogue_robot, robot_of
from tests.support.loops import circle_beside, energy_along

RIGID = pa.Unknown(friction=False, armature=False)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["panda", "scara", "mixed"])
def test_lyapunov_equality_with_a_disturbance_that_is_no_small_part_of_v(name):
    """From an estimate of 30 rad/s^2 times each joint's inertia, beside a model that is 2 % off."""
    robot = robot_of("separation", name)
    load = pa.Payload(0.02 * robot.mass, [0.0, 0.02, 0.05])
    true = robot.changed(payload=load, tool_translation=[0.0, 0.002, 0.0])
    controller = pa.make_controller(robot.changed(inertial_scale=0.98), gamma_d=20.0, unknown=RIGID)
    law = controller.law
    assert controller.adaptation_d.name == "natural-memory" and (law.lambda_d <= law.alpha).all()

    def begin(state):
        controller.dynamics.load(controller.dynamics.initial)
        M = controller.dynamics.mass_matrix(robot.q0)
        d = 30.0 * np.diag(M) * np.cos(np.arange(robot.model.nv))
        return state._replace(filters=state.filters._replace(disturbance=d))

    path = circle_beside(true, "xy" if name == "scara" else "yz", (1e-3, -1e-3, 2e-3))
    energy = energy_along(true, controller, path, seconds=6e-3, dt=3e-4, begin=begin)
    d, wrong = (
        np.array([part(s) for s, _, _ in energy.samples])
        for part in (lambda s: s.filtered.disturbance, lambda s: s.residual)
    )
    weighted = d / np.diag(law.K_v)
    stored = 0.25 * np.sum(d * weighted / law.lambda_d, axis=1)
    added, predicted = (0.5 * np.sum(each * weighted, axis=1) for each in (d, wrong))
    assert energy.mismatch(after=10) <= 2e-5
    assert stored[10:].max() > 0.05 * energy.V[0]
    assert np.abs(added[10:]).max() > 0.05 * np.abs(energy.rate).max()
    assert np.abs(predicted[10:]).max() > 1e-3 * np.abs(energy.rate).max()


class Pushed(pa.plants.PinocchioPlant):
    """A robot to whose joints others apply a constant torque."""

    push = 0.0

    def step(self, torque, dt):
        super().step(torque + self.push, dt)


@pytest.mark.parametrize("name", ["panda", "scara"])
def test_a_torque_of_others_is_estimated_and_leaves_no_error(name):
    """Estimates rest, at the truth: nothing else explains a twentieth of the motors' limits."""
    robot = catalogue_robot(name)
    ends = []
    held = robot.position(robot.q0)
    push = 0.05 * robot.model.effortLimit
    push = push * np.cos(np.arange(push.size))
    for adaptation in ("natural-memory", "natural"):
        controller = pa.make_controller(
            robot, adaptation=adaptation, unknown=RIGID, limits=pa.Limits(guards=False), dt=2e-3
        )
        plant = Pushed(robot)
        plant.push = push
        start = controller.init(plant.measure(), adapting=False)
        stream = pa.run(plant, controller, pa.trajectories.Hold(held), dt=2e-3, state=start)
        samples = list(islice(stream, 750))
        assert np.array_equal(samples[-1].state.a_d, start.a_d)
        errors = [np.abs(sample.measurement.x - held).max() for sample in samples]
        ends.append((samples[-1].state.filters.disturbance, max(errors), errors[-1]))
    (found, largest, last), (none, _, left) = ends
    assert np.allclose(found, push, rtol=1e-6, atol=0.0)
    assert largest > 1e-4 and last < 1e-9
    assert not none.any() and left > 5e-4  # without a prediction of the torque
