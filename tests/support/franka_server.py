"""A Franka in a process of its own: ``franky-sim`` with a load, and a camera of its tool.

``python -m tests.support.franka_server HOST REALTIME PORT`` serves until it is killed: in real
time, or, while it gets torques, a millisecond of the robot with each of them, however late. Frames,
time and position of the tool as MuJoCo has them, are sent to the port of this machine, thirty a
second.
"""

import json
import os
import re
import select
import socket
import subprocess
import sys

import numpy as np

from tests.support.paths import ROOT

TOOL = np.array([0.02, -0.01, 0.05])  # [m] beyond panda_hand_tcp, in its axes
HOME = (0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785)
PATIENCE = 0.3  # [s] for a torque; libfranka waits longer
MASS = 0.6  # [kg] at the tool


class Franka:
    """A running server, and what its camera sees.

    Attributes:
        address: where it answers.
    """

    def __init__(self, address, *, realtime=False):
        self.address, self._eye = address, socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._eye.bind(("127.0.0.1", 0))
        self._eye.setblocking(False)
        command = [sys.executable, "-m", "tests.support.franka_server", address]
        command += [str(int(realtime)), str(self._eye.getsockname()[1])]
        paths = os.pathsep.join([str(ROOT), *filter(None, sys.path)])
        self.process = subprocess.Popen(
            command, env={**os.environ, "PYTHONPATH": paths}, stdout=subprocess.PIPE, text=True
        )
        assert re.match("ready", self.process.stdout.readline())

    def camera(self):
        """Return position of the tool and time of the newest frame, or None."""
        newest = None
        try:
            while True:
                newest = json.loads(self._eye.recv(1 << 12))
        except BlockingIOError:
            pass
        return None if newest is None else (np.array(newest["x"]), newest["t"])

    def close(self):
        """Kill the server."""
        self.process.kill()
        self.process.wait(10.0)
        self.process.stdout.close()
        self._eye.close()


def serve(address, realtime, port):
    """Serve until the process is killed."""
    import xml.etree.ElementTree as ET

    import mujoco
    from franky_sim import SimulationServer
    from franky_sim.mujoco_simulator import MujocoSimulator

    eye = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    with MujocoSimulator() as sim:
        sim.add_robot(HOME)
        (hand,) = sim.worldbody.findall(".//body[@name='robot0_hand']")
        place = " ".join(map(str, TOOL + np.array([0.0, 0.0, 0.1034])))
        tool = ET.SubElement(hand, "body", name="tool", pos=place)
        ET.SubElement(tool, "inertial", pos="0 0 0", mass=str(MASS), diaginertia="1e-3 1e-3 1e-3")
        with SimulationServer(sim, [address]) as server:
            (robot_server,) = server.robot_servers
            body = mujoco.mj_name2id(sim.model, mujoco.mjtObj.mjOBJ_BODY, "tool")

            def see(sim):
                number = robot_server._FrankaServer__message_id  # milliseconds of the robot
                if number % 33 == 0 and robot_server.udp_connected:
                    mujoco.mj_kinematics(sim.model, sim.data)
                    x = sim.data.xpos[body].tolist()
                    eye.sendto(json.dumps({"x": x, "t": 1e-3 * number}).encode(), port)

            sim.register_post_step_callback(see)
            print("ready", flush=True)
            while True:
                moving = robot_server.current_motion_id and robot_server.udp_connected
                if moving and not realtime:  # the robot's time goes on with each torque
                    select.select([robot_server._FrankaServer__udp_socket], [], [], PATIENCE)
                server.run_once(realtime=realtime or not moving)


if __name__ == "__main__":
    serve(sys.argv[1], sys.argv[2] == "1", ("127.0.0.1", int(sys.argv[3])))
