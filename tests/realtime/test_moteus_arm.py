"""Motors on a CAN bus by the vendor's client, on python-can's virtual bus with simulated motors."""

import math
import struct
import threading
import time
from dataclasses import replace

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.exceptions import ArmError
from pinadapt.realtime import RealtimeLoop, Safety
from tests.support.arms import ORDINARY, PERIOD, robot

can = pytest.importorskip("can", reason="the extra moteus is not installed")
moteus = pytest.importorskip("moteus", reason="the extra moteus is not installed")
from pinadapt.realtime.moteus_arm import MoteusArm, Motor  # noqa: E402

MOTORS = [Motor("joint1", 3, -1, 6.0, 0.4, 1.1), Motor("joint2", 7, 1, 1.0, -0.2)]
SIZES = (*range(9), 12, 16, 20, 24, 32, 48, 64)


class Motors(threading.Thread):
    """Motors of an arm on a virtual bus, each with its own delay; the first query is a period.

    Attributes:
        plant: that they move.
        braked: which of them have been told to brake.
        fault: of the first one.
    """

    def __init__(self, channel):
        super().__init__(daemon=True)
        self.bus = can.Bus(interface="virtual", channel=channel, fd=True)
        self.plant = pa.plants.PinocchioPlant(robot())
        self.torque = np.zeros(2)
        self.braked, self.fault, self.count = set(), 0, 0
        self.begun, self.running = False, True
        self.start()

    def run(self):
        message = None
        while self.running or message is not None:
            message = self.bus.recv(0.2)
            if message is not None:
                self.answer(message)
        self.bus.shutdown()

    def answer(self, message):
        ids = [motor.id for motor in MOTORS]
        if message.arbitration_id & 0x7F not in ids:
            return
        k = ids.index(message.arbitration_id & 0x7F)
        said = moteus.parse_registers(bytes(message.data))
        mode = said.command.get(moteus.Register.MODE)
        if mode == moteus.Mode.BRAKE:
            self.braked.add(k)
        torque = said.command.get(moteus.Register.COMMAND_FEEDFORWARD_TORQUE)
        if torque is not None:
            assert said.command[moteus.Register.COMMAND_KP_SCALE] == 0.0
            assert math.isnan(said.command[moteus.Register.COMMAND_POSITION])
            motor = MOTORS[k]
            self.torque[k] = motor.sign * motor.ratio * motor.torque * torque
            self.begun = True
        if not message.arbitration_id & 0x8000:
            return
        if k == 0:
            self.count += 1
            if self.begun:
                self.plant.step(self.torque, PERIOD)
        time.sleep(3e-4 * k)
        self.bus.send(self.reply(k, message, said.query))

    def reply(self, k, message, query):
        """Return the registers of a motor."""
        seen, motor = self.plant.measure(), MOTORS[k]
        turns = motor.sign * motor.ratio / (2.0 * np.pi)
        names = moteus.Register
        values = {
            names.MODE: 1 if self.fault and k == 0 else 10,
            names.POSITION: turns * (seen.q[k] - motor.offset),
            names.VELOCITY: turns * seen.v[k],
            names.TORQUE: self.torque[k] / (motor.sign * motor.ratio * motor.torque),
            names.VOLTAGE: 48,
            names.TEMPERATURE: 30,
            names.FAULT: self.fault if k == 0 else 0,
        }
        data = b""
        for register, kind in query:
            value = values[register]
            coded = struct.pack("<f", value) if kind == 3 else struct.pack("<b", int(value))
            data += bytes([0x20 | kind << 2 | 1, register]) + coded
        size = next(size for size in SIZES if size >= len(data))
        return can.Message(
            arbitration_id=motor.id << 8 | message.arbitration_id >> 8 & 0x7F,
            is_extended_id=True,
            data=data + b"\x50" * (size - len(data)),
            is_fd=True,
        )


@pytest.fixture
def motors(request):
    """Return motors on a channel of their own."""
    nodes = Motors(request.node.name)
    yield nodes
    nodes.running = False
    nodes.join(5.0)


def arm_of(request, nodes, motors=MOTORS, timeout=2.0):
    """Return the arm of some motors, whose clock counts their periods."""
    options = {"interface": "virtual", "channel": request.node.name, "period": PERIOD}
    clock = lambda: nodes.count * PERIOD  # noqa: E731
    return MoteusArm(robot(), motors, timeout=timeout, clock=clock, **options)


@pytest.fixture
def on(request, motors):
    """Return the arm of the motors."""
    return arm_of(request, motors)


def drive(arm, stage="hold", seconds=0.3, each=None):
    """Return the ending of a run, and its messages."""
    described = pa.load("planar_2r", task="joint", gravity=[0.0, -9.81, 0.0])
    controller = pa.make_controller(described, dt=PERIOD, adaptation="natural")
    swing = pa.trajectories.Sinusoid(described.home_angles + 0.1, 0.1, 1.0)
    said, read, count = [], arm.read, iter(range(10**9))
    arm.facts = replace(arm.facts, clock="simulated")  # it counts queries

    def reading():
        if each is not None:
            each(next(count))
        return read()

    arm.read = reading
    with arm:
        loop = RealtimeLoop(
            arm,
            controller,
            swing,
            stage=stage,
            safety=Safety(late=10**6),
            scheduling=ORDINARY,
            say=said.append,
        )
        return loop.run(seconds), said


def test_the_table_turns_counts_into_angles(on, motors):
    with on as arm:
        m = arm.read()
        assert np.allclose(m.q, robot().q0, atol=1e-6) and np.allclose(m.tau, 0.0)
        assert not arm.facts.paced and arm.facts.joints == ("joint1", "joint2")
        arm.send(np.array([3.0, -2.0]))
        arm.read()
        assert np.allclose(motors.torque, [3.0, -2.0], rtol=1e-6)
        for wrong in ([np.nan, 0.0], [np.inf, 0.0], [1.0], None):
            with pytest.raises(pa.InputError, match="torque"):
                arm.send(wrong)
    motors.running = False
    motors.join(5.0)
    assert motors.braked == {0, 1}


def test_a_motion_is_followed_and_ends_in_brakes(on, motors):
    ending, said = drive(on, "adapt", 0.4)
    assert not ending.failed and said[-1].startswith("stopped"), said
    assert np.abs(motors.plant.measure().v).max() < 0.05
    assert np.abs(motors.plant.measure().q - robot().q0).max() > 5e-3


def test_a_faulty_motor_stops_the_others(on, motors):
    def fault(count):
        if count == 100:
            motors.fault = 33

    ending, _ = drive(on, seconds=9.0, each=fault)
    assert ending.failed and "the motor of joint1 has fault 33" in ending.reason


def test_a_motor_that_does_not_answer_is_named(request, motors):
    wrong = [MOTORS[0], replace(MOTORS[1], id=9)]
    with (
        arm_of(request, motors, wrong, timeout=0.1) as arm,
        pytest.raises(ArmError, match="the motor of joint2 has not answered"),
    ):
        arm.read()
