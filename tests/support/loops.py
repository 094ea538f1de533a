"""Short closed loops: true robots and paths, and V with the dV/dt that the law's proof claims."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any

import numpy as np

import pinadapt as pa
from pinadapt.rollout.recording import truth_at
from tests.support.chains import catalogue_robot
from tests.support.differences import sampled_derivative

ARRAYS = ("t", "q", "v", "tau", "x", "x_d", "error", "a_k", "a_d")  # of a rollout


@dataclass(frozen=True, eq=False)
class Energy:
    """V along a run of N samples, the dV/dt of the proof, and the task error (m rows) meanwhile.

    Attributes:
        V: (N) the law's storage and that of the parameters.
        rate: (N) dV/dt by the formulas of the law and of the adaptation.
        numerical: (N - 4) dV/dt by differences of V, from the third sample to the last but two.
        dx: (N, m) task error.
        delta: (N, m) its drift beside the difference of velocities, zero but for rotations.
        samples: (N) signals, drive of the kinematic estimate and controller's state.
    """

    V: np.ndarray
    rate: np.ndarray
    numerical: np.ndarray
    dx: np.ndarray
    delta: np.ndarray
    samples: list[tuple[Any, Any, Any]]

    def mismatch(self, after: int = 0) -> float:
        """Return the largest difference of the two dV/dt, relative to the largest dV/dt."""
        return float(
            np.abs(self.numerical - self.rate[2:-2])[after:].max() / np.abs(self.rate).max()
        )

    def largest_rise(self) -> float:
        """Return V's largest rise between samples, relative to its first value."""
        return float(np.diff(self.V).max() / self.V[0])

    def check(self, within: float = 1e-4, after: int = 0, moved: float = 1e-4) -> None:
        """V moves, never rises, and from a sample on its rate is that of the proof."""
        assert self.mismatch(after) <= within
        assert np.abs(self.rate).max() > moved
        assert (self.rate <= 0.0).all() and self.largest_rise() <= 1e-12


def circle_at_home(robot):
    """Return a circle that starts at the robot's home at full speed: short loops show motion."""
    circle = pa.trajectories.Circle(np.zeros(robot.task.size), 0.05, 2.0)
    return circle.starting_at(robot.position(robot.q0)).as_given()


def motion_at_home(robot):
    """Return a motion that starts at the robot's home: of its frame a circle, of joints a swing."""
    if isinstance(robot.task, pa.tasks.JointTask):
        return pa.trajectories.Sinusoid(robot.home_angles + 0.1, 0.1, 2.0).as_given()
    return circle_at_home(robot)


def run(name="planar_2r", *, truth=None, control=None, **options):
    """Return a short rollout of an adaptive controller with a model 20 % too light."""
    described = catalogue_robot(name)
    true = described.changed(**(truth or {}))
    control = {"adaptation": "natural", **(control or {})}
    controller = pa.make_controller(described.changed(inertial_scale=0.8), **control)
    return pa.simulate(true, controller, circle_at_home(true), **{"duration": 0.1, **options})


def with_tool_and_load(robot: pa.Robot) -> pa.Robot:
    """Return the robot with a tool 9 cm off its frame and a load of 1 kg."""
    load = pa.Payload(1.0, [0.01, 0.0, 0.05], [0.01, 0.0, 0.01, 0.0, 0.0, 0.01])
    return robot.changed(tool_translation=[0.03, -0.02, 0.08], payload=load)


def circle_beside(
    robot: pa.Robot, plane: str, by: Sequence[float] = (0.01, -0.01, 0.02)
) -> pa.trajectories.Trajectory:
    """Return a circle of 5 cm in two seconds, at speed beside home by an offset (3) [m]."""
    circle = pa.trajectories.Circle(np.zeros(3), 0.05, 2.0, plane)
    return circle.starting_at(robot.position(robot.q0) + np.array(by)).as_given()


def check_holds_home(robot: pa.Robot) -> None:
    """The default controller of a robot that equals its model stays at its home."""
    rollout = pa.simulate(
        robot,
        pa.make_controller(robot),
        pa.trajectories.Hold(robot.position(robot.q0)),
        duration=0.02,
    )
    assert rollout.diverged is None
    assert rollout.distance.max() < 1e-3


def energy_along(
    true: pa.Robot,
    controller: pa.Controller,
    path: pa.trajectories.Trajectory,
    *,
    seconds: float,
    dt: float = 4e-4,
    begin: Callable[[Any], Any] = lambda state: state,
    **start: Any,
) -> Energy:
    """Run the continuous loop with ideal acceleration from home at rest, and trace V.

    The ideal acceleration is that of the unclipped torque: there are no torque limits.

    Args:
        true: the robot that is controlled.
        controller: the controller, made for another.
        path: the desired motion.
        seconds: how long, N samples.
        dt: integration step and time between samples [s].
        begin: returns the state to start from, of that by ``Controller.init``.
        start: initial estimates a_k, a_d instead of those of the model.
    """
    plant = pa.plants.PinocchioPlant(true)
    controller = controller.limited(None)
    state = begin(controller.init(plant.measure(), **start))
    stream = pa.simulation.run_continuous(
        plant, controller, path, dt=dt, state=state, ideal_acceleration=True
    )
    a_k = controller.kinematics.value(true)
    a_d = controller.dynamics.value(true)
    V, rate, dx, delta, samples = [], [], [], [], []
    for sample in list(islice(stream, round(seconds / dt))):
        signals, command = controller.command(sample.state, sample.measurement, sample.desired)
        q = sample.measurement.q
        v = sample.measurement.v
        if controller.law.uses_acceleration:
            a = plant.acceleration_at(q, v, command.torque, command.feedthrough)
            drives = controller.respond(sample.state, signals.replaced(a=a))[1]
        else:
            drives = controller.sent(signals, command)[1]
        truth = truth_at(plant, sample, a_k, a_d)
        law = controller.law
        state = sample.state
        adaptation_k = controller.adaptation_k
        adaptation_d = controller.adaptation_d
        of_law = law.storage(signals, truth)
        learned = controller.parameter_storage(state, a_k, a_d)
        V.append(of_law + learned)
        of_law = law.dissipation(signals, truth)
        of_law += adaptation_k.dissipation(state.kinematic, drives.kinematic, a_k)
        learned = adaptation_d.dissipation(state.dynamic, drives.dynamic, a_d)
        rate.append(of_law + learned)
        samples.append((signals, drives.kinematic, state))
        dx.append(signals.dx.copy())
        delta.append(np.zeros_like(signals.dx) if signals.delta is None else signals.delta.copy())
    V = np.array(V)
    rate = np.array(rate)
    return Energy(V, rate, sampled_derivative(V, dt), np.array(dx), np.array(delta), samples)


def check_kinematic_part(energy, controller, true):
    """V_k = c (|dx_o|^2 + (l |eta|)^2) / 2 + D_k alone, as it is small beside V_d."""
    law = controller.law
    adaptation = controller.adaptation_k
    a_k = controller.kinematics.value(true)
    V = []
    rate = []
    for s, drive, state in energy.samples:
        observed = s.filtered.dx_o @ s.filtered.dx_o
        if law.lever:
            observed += law.lever**2 * s.filtered.eta @ s.filtered.eta
        V.append(law.c * observed / 2.0 + adaptation.storage(state.kinematic, a_k))
        learned = adaptation.dissipation(state.kinematic, drive, a_k)
        rate.append(learned - law.c * law.beta * observed - s.epsilon @ law.R_k @ s.epsilon)
    dt = energy.samples[1][0].t - energy.samples[0][0].t
    numerical = sampled_derivative(np.array(V), dt)
    assert np.abs(numerical - rate[2:-2]).max() <= 2e-5 * np.abs(rate).max()
    assert max(rate[1:]) < 0.0  # at first nothing is known to be wrong


def same(one, other):
    """Return whether two rollouts are equal to the last bit."""
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in ARRAYS)
