"""A Franka in a separate process: ``franky-sim`` with a load, and a camera of its tool.

``python -m tests.support.franka_server HOST REALTIME PORT`` serves until it is killed: in real
time, or, while it gets torques, a millisecond of the robot with each of them, however late. Frames,
time and position of the tool as MuJoCo has them, are sent to the port of this machine, thirty a
second. From there it may be told of a force on the tool and of the user stop. ``franky-sim``
acknowledges collision behaviour and recovery and does not simulate them; here a force above the
thresholds is a reflex, reported over the protocol as by a robot.
"""

import json
import os
import re
import select
import socket
import subprocess
import sys
import time

import numpy as np

from tests.support.paths import ROOT

TOOL = np.array([0.02, -0.01, 0.05])  # [m] beyond panda_hand_tcp, in its axes
HOME = (0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785)
PATIENCE = 0.3  # [s] for a torque; libfranka waits longer
ASLEEP = 0.02  # [s] between two looks for a client
MASS, FINGERS = 0.6, 0.03  # [kg] at the tool, and of the hand's two fingers
REFLEX = 6  # place of the joints' reflex among the robot's errors


class Franka:
    """A running server, and what its camera sees.

    Attributes:
        address: where it answers.
    """

    def __init__(self, address, *, realtime=False):
        self.address = address
        self._eye = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._eye.bind(("127.0.0.1", 0))
        self._eye.setblocking(False)
        command = [sys.executable, "-m", "tests.support.franka_server", address]
        command += [str(int(realtime)), str(self._eye.getsockname()[1])]
        paths = os.pathsep.join([str(ROOT), *filter(None, sys.path)])
        self.process = subprocess.Popen(
            command, env={**os.environ, "PYTHONPATH": paths}, stdout=subprocess.PIPE, text=True
        )
        self._port = int(re.match(r"ready (\d+)", self.process.stdout.readline())[1])

    def camera(self):
        """Return position of the tool and time of the newest frame, or None."""
        newest = None
        try:
            while True:
                newest = json.loads(self._eye.recv(1 << 12))
        except BlockingIOError:
            pass
        return None if newest is None else (np.array(newest["x"]), newest["t"])

    def tell(self, **what):
        """Tell the robot of a ``push`` (3) [N] at its tool, or that its user ``stopped`` it."""
        self._eye.sendto(json.dumps(what).encode(), ("127.0.0.1", self._port))

    def close(self):
        """Kill the server."""
        self.process.kill()
        self.process.wait(10.0)
        self.process.stdout.close()
        self._eye.close()


class Body:
    """Events of the robot: forces, its reflex and recovery, and the user stop."""

    def __init__(self):
        self.push = np.zeros(3)
        self.stopped = False
        self.reflex = False
        self.thresholds = np.full(7, np.inf)

    def hear(self, eye):
        """Receive what the test sends."""
        try:
            told = json.loads(eye.recv(1 << 12))
        except BlockingIOError:
            return
        self.push = np.array(told.get("push", self.push), dtype=float)
        self.stopped = told.get("stopped", self.stopped)

    def install(self, protocol, kind):
        """Have the server answer for it."""
        plain = kind.robot_state.fget
        body = self

        def handle_behaviour(command, server):
            body.thresholds = np.array(command.upper_torque_thresholds_nominal)
            command.reply(0)

        def handle_recovery(command, server):
            body.reflex = False
            command.reply(protocol.AutomaticErrorRecoveryStatus.kSuccess)

        def state(server):
            seen = plain(server)
            if body.stopped:
                return seen.replace(robot_mode=protocol.RobotMode.kUserStopped)
            if not body.reflex:
                return seen
            errors = tuple(k == REFLEX for k in range(41))
            return seen.replace(
                robot_mode=protocol.RobotMode.kReflex, errors=errors, reflex_reason=errors
            )

        protocol.SetCollisionBehaviorCommand.handle = handle_behaviour
        protocol.AutomaticErrorRecoveryCommand.handle = handle_recovery
        kind.robot_state = property(state)

    def feel(self, torque, server, protocol):
        """Abort the motion where an external torque (7) exceeds its threshold."""
        if self.reflex or not server.current_motion_id:
            return
        if (np.abs(torque) > self.thresholds).any():
            number = server.current_motion_id
            self.reflex = True
            server.stop_motion(send_preemption_signal=False)
            server.send_state()
            kind = protocol.RobotCommand.kMove
            aborted = protocol.MoveStatus.kReflexAborted
            protocol.MoveCommand.send_response(server._tcp_socket, kind, number, aborted)
            server.reset_current_motion_id()


def serve(address, realtime, port):
    """Serve until the process is killed."""
    import xml.etree.ElementTree as ET

    import mujoco
    from franky_sim import SimulationServer, franka_robot_protocol, franka_robot_server
    from franky_sim.mujoco_simulator import MujocoSimulator

    eye = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    felt = Body()
    eye.bind(("127.0.0.1", 0))
    eye.setblocking(False)
    felt.install(franka_robot_protocol, franka_robot_server.FrankaRobotServer)
    with MujocoSimulator() as sim:
        sim.add_robot(HOME)
        (hand,) = sim.worldbody.findall(".//body[@name='robot0_hand']")
        place = " ".join(map(str, TOOL + np.array([0.0, 0.0, 0.1034])))
        tool = ET.SubElement(hand, "body", name="tool", pos=place)
        ET.SubElement(tool, "inertial", pos="0 0 0", mass=str(MASS), diaginertia="1e-3 1e-3 1e-3")
        with SimulationServer(sim, [address]) as server:
            (robot_server,) = server.robot_servers
            body = mujoco.mj_name2id(sim.model, mujoco.mjtObj.mjOBJ_BODY, "tool")

            jacobian = np.zeros((3, sim.model.nv))

            def push(sim):
                felt.hear(eye)
                sim.data.xfrc_applied[body, :3] = felt.push
                if felt.push.any():
                    mujoco.mj_jacBody(sim.model, sim.data, jacobian, None, body)
                    felt.feel(felt.push @ jacobian[:, :7], robot_server, franka_robot_protocol)

            def see(sim):
                number = robot_server._FrankaServer__message_id  # milliseconds of the robot
                if number % 33 == 0 and robot_server.udp_connected:
                    mujoco.mj_kinematics(sim.model, sim.data)
                    x = sim.data.xpos[body].tolist()
                    eye.sendto(json.dumps({"x": x, "t": 1e-3 * number}).encode(), port)

            sim.register_pre_step_callback(push)
            sim.register_post_step_callback(see)
            print("ready", eye.getsockname()[1], flush=True)
            while True:
                if not robot_server.udp_connected:
                    time.sleep(ASLEEP)
                moving = robot_server.current_motion_id and robot_server.udp_connected
                if moving and not realtime:  # the robot's time goes on with each torque
                    select.select([robot_server._FrankaServer__udp_socket], [], [], PATIENCE)
                server.run_once(realtime=realtime or not moving)


if __name__ == "__main__":
    serve(sys.argv[1], sys.argv[2] == "1", ("127.0.0.1", int(sys.argv[3])))
