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
        self.braked = set()
        self.fault = 0
        self.count = 0
        self.begun = False
        self.running = True
        self.start()

    def run(self):
        message = None
        while self.running or message is not None:
            message = self.bus.recv(0.2)
            for k, motor in enumerate(MOTORS):
                if message is not None and message.arbitration_id & 0x7F == motor.id:
                    self.answer(k, motor, message)
        self.bus.shutdown()

    def answer(self, k, motor, message):
        said = moteus.parse_registers(bytes(message.data))
        names = moteus.Register
        gear = motor.sign * motor.ratio
        if said.command.get(names.MODE) == moteus.Mode.BRAKE:
            self.braked.add(k)
        torque = said.command.get(names.COMMAND_FEEDFORWARD_TORQUE)
        if torque is not None:
            assert said.command[names.COMMAND_KP_SCALE] == 0.0
            assert math.isnan(said.command[names.COMMAND_POSITION])
            self.torque[k], self.begun = gear * motor.torque * torque, True
        if not message.arbitration_id & 0x8000:
            return
        if k == 0:
            self.count += 1
            if self.begun:
                self.plant.step(self.torque, PERIOD)
        time.sleep(3e-4 * k)
        seen = self.plant.measure()
        fault = self.fault if k == 0 else 0
        values = {
            names.MODE: 1 if fault else 10,
            names.POSITION: gear / (2.0 * np.pi) * (seen.q[k] - motor.offset),
            names.VELOCITY: gear / (2.0 * np.pi) * seen.v[k],
            names.TORQUE: self.torque[k] / (gear * motor.torque),
            names.VOLTAGE: 48,
            names.TEMPERATURE: 30,
            names.FAULT: fault,
        }
        data = b""
        for register, kind in said.query:
            data += bytes([0x20 | kind << 2 | 1, register])
            data += struct.pack("<f" if kind == 3 else "<b", values[register])
        reply = {
            "arbitration_id": motor.id << 8 | message.arbitration_id >> 8 & 0x7F,
            "data": data.ljust(next(size for size in SIZES if size >= len(data)), b"\x50"),
        }
        self.bus.send(can.Message(is_extended_id=True, is_fd=True, **reply))


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
    arm = MoteusArm(robot(), motors, timeout=timeout, clock=lambda: nodes.count * PERIOD, **options)
    arm.facts = replace(arm.facts, clock="simulated")  # it counts queries
    return arm


@pytest.fixture
def on(request, motors):
    """Return the arm of the motors."""
    return arm_of(request, motors)


def drive(arm, stage="hold", seconds=0.3):
    """Return the ending of a run, and its messages."""
    described = pa.load("planar_2r", task="joint", gravity=[0.0, -9.81, 0.0])
    controller = pa.make_controller(described, dt=PERIOD, adaptation="natural")
    swing = pa.trajectories.Sinusoid(described.home_angles + 0.1, 0.1, 1.0)
    said = []
    options = {"safety": Safety(late=10**6), "scheduling": ORDINARY, "say": said.append}
    with arm:
        return RealtimeLoop(arm, controller, swing, stage=stage, **options).run(seconds), said


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


def test_a_faulty_motor_stops_the_others(on, motors, monkeypatch):
    read = on.read

    def fault():
        motors.fault = 33 * (motors.count > 100)
        return read()

    monkeypatch.setattr(on, "read", fault)
    ending, _ = drive(on, seconds=9.0)
    assert ending.failed and "the motor of joint1 has fault 33" in ending.reason


def test_a_motor_that_does_not_answer_is_named(request, motors):
    wrong = [MOTORS[0], replace(MOTORS[1], id=9)]
    with (
        arm_of(request, motors, wrong, timeout=0.1) as arm,
        pytest.raises(ArmError, match="the motor of joint2 has not answered"),
    ):
        arm.read()
