"""A planar arm with the interface of real ones, and its possible faults."""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache, partial
from multiprocessing import get_context

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.realtime import PlantArm, RealtimeLoop, Scheduling

PERIOD = 4e-3
ORDINARY = Scheduling(None, None, False)  # as any program


@contextmanager
def forking() -> Iterator[None]:
    """Let the processes of arms and logs be copies of this one, which import nothing."""
    with pytest.MonkeyPatch.context() as patched:
        for part in ("processes", "recorder"):
            patched.setattr(
                f"pinadapt.realtime.{part}.get_context", lambda kind: get_context("fork")
            )
        yield


@cache
def robot():
    """Return the arm as described, in a vertical plane."""
    return pa.load("planar_2r", gravity=[0.0, -9.81, 0.0])


@cache
def heavy():
    """Return the arm as it is: with a load of 0.5 kg."""
    return robot().changed(payload=pa.Payload(0.5, [0.0, 0.0, 0.0]))


@cache
def controller(**options):
    """Return a controller of the described arm."""
    given = {"limits": pa.Limits(torque=[120.0, 60.0]), **options}
    return pa.make_controller(robot(), dt=PERIOD, **given)


def circle():
    """Return a small circle at the home of the arm."""
    return pa.trajectories.Circle(robot().position(robot().q0), 0.1, 2.0)


def arm(true=None, kind=PlantArm, **options):
    """Return a simulated arm in this process."""
    return kind(pa.plants.PinocchioPlant(heavy() if true is None else true), PERIOD, **options)


class Loop:
    """A loop on an arm, its messages, and its ending."""

    def __init__(self, on=None, stage="adapt", seconds=0.4, motion=None, of=None, **options):
        self.said = []
        self.arm = arm() if on is None else on
        self.loop = RealtimeLoop(
            self.arm,
            controller() if of is None else of,
            circle() if motion is None else motion,
            stage=stage,
            scheduling=ORDINARY,
            say=self.said.append,
            **options,
        )
        self.run = partial(self.loop.run, seconds)

    def ended(self):
        """Run, check that the arm has stopped, and return the ending."""
        with self.arm:
            ending = self.run()
            assert self.arm.stopped
        return ending

    @property
    def phases(self):
        """Names of the phases in their order."""
        return [phase for _, phase, _ in self.loop.result.phases]


class Faulty(PlantArm):
    """An arm to which something happens at a cycle of the loop.

    Attributes:
        cycle: number of measurements so far.
        sent: torques that it got.
    """

    def __init__(self, *arguments, at=75, fault=None, **options):
        super().__init__(*arguments, **options)
        self.cycle, self.at, self.fault, self.sent = 0, at, fault, []

    def read(self):
        self.cycle += 1
        m = super().read()
        if self.fault is not None and self.cycle >= self.at:
            return self.fault(self, m)
        return m

    def send(self, torque):
        self.sent.append(np.array(torque))
        super().send(torque)


def faulty(fault, at=75, **options):
    """Return an arm with a fault, a function of the arm and its measurement."""
    return arm(kind=partial(Faulty, at=at, fault=fault), **options)
