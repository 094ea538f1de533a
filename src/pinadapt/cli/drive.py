"""``pinadapt drive``, ``replay`` and ``tell``: an arm in real time, its log, and its commands."""

from __future__ import annotations

import json
import runpy
import time
from argparse import ArgumentParser, Namespace
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from .._checks import located, mapping
from .._output import Report, Table
from ..controller.learned import LearnedParameters
from ..exceptions import InputError, ScenarioError
from ..realtime.arm import Arm, ProcessArm
from ..realtime.franka import FrankaArm, at_task_frame
from ..realtime.processes import Scheduling
from ..realtime.realtime_loop import RealtimeLoop, Stage
from ..realtime.recorder import COMMANDS, CycleLog, Recorder
from ..realtime.recorder import tell as tell_loop
from ..realtime.safety import Safety
from ..records import Measurement
from ..reference import starting_from
from ..robot.changes import Payload
from ..robot.robot import Robot
from ..scenario.scenario import Scenario, described_robot, trajectory_of
from ..scenario.tables import (
    Tables,
    at_folder,
    made,
    parts,
    plain,
    read_tables,
    setting,
    with_values,
)
from ..trajectories.trajectory import Trajectory
from ..tuning.preflight import preflight
from .command_line import Exit, add_arguments_of, add_settings, given

_STAGES = {
    "log-only": (Stage.LOG, "compute and log torques, send none (default)"),
    "gravity": (Stage.GRAVITY, "compensate gravity, to move the arm by hand"),
    "hold": (Stage.HOLD, "hold the present position"),
    "slow": (Stage.SLOW, "the motion five times slower, without adaptation"),
    "adapt": (Stage.ADAPT, "the motion with adaptation"),
}
_COLLISION = ("collision", "forces")
FRANKA = {
    "title": "Franka, load unknown",
    "robot": {"source": "panda", "task": "joint"},
    "trajectory": {"kind": "sinusoid", "period": 6.0},
    "controller": {"compensated": "nominal"},
}


def drive_arguments(parser: ArgumentParser) -> None:
    """Add the arguments of ``drive``."""
    parser.add_argument(
        "kind",
        metavar="ARM",
        help='"simulated", "franka", "moteus", or FILE.py:CLASS of an Arm of your own',
    )
    parser.add_argument("address", nargs="?", metavar="ADDRESS", help="of the arm")
    parser.add_argument(
        "--scenario",
        dest="file",
        type=Path,
        metavar="FILE",
        help="robot, controller and motion; without one a Franka moves its joints",
    )
    add_settings(parser)
    stages = parser.add_mutually_exclusive_group()
    for name, (stage, text) in _STAGES.items():
        stages.add_argument(f"--{name}", dest="stage", action="store_const", const=stage, help=text)
    parser.set_defaults(stage=Stage.LOG)
    parser.add_argument("--duration", type=float, metavar="S", help="(default: until Ctrl-C)")
    parser.add_argument(
        "--log", type=Path, metavar="FILE", help="MCAP file (default: out/ and the time)"
    )
    parser.add_argument(
        "--port",
        type=int,
        default=0,
        metavar="N",
        help="for `pinadapt tell` and `view`, on this machine only (default: any)",
    )
    franka = parser.add_argument_group("only of a Franka")
    add_arguments_of(
        franka,
        FrankaArm.__init__,
        {
            "recover": {"action": "store_true"},
            "collision": {"type": float, "nargs": 7, "metavar": "NM"},
            "forces": {"type": float, "nargs": 6, "metavar": "N"},
        },
    )
    franka.add_argument(
        "--load",
        metavar="JSON",
        help="load that is set on the robot, which then compensates it: mass, com and inertia in "
        """the axes of the flange, such as '{"mass": 0.7, "com": [0, 0, 0.1]}'""",
    )
    parser.add_argument("--core", type=int, metavar="N", help="processor core to stay on")
    parser.add_argument(
        "--safety",
        nargs="+",
        action="extend",
        default=[],
        metavar="KEY=VALUE",
        help="numbers of the checklist, such as error=0.05 contact=0.2",
    )


def drive(options: Namespace) -> int:
    """Drive an arm, print the histogram of its cycles, and save what was learned beside the log.

    Return 3 if a finding ended it, 130 after Ctrl-C, else 0.

    Raises:
        InputError: arm, scenario or settings cannot be used.
        ArmError: the arm refuses.
    """
    safety = made(Safety, dict(setting(text, "--safety") for text in options.safety), "safety")
    for name in given(options, ("load", *_COLLISION)):
        if options.kind != "franka":
            raise InputError("is set on a Franka only.", where=f"--{name}")
    tables, folder, load = _tables(options)
    scenario = Scenario.build(tables, folder)
    controller = scenario.controller
    for finding in preflight(controller, controller.period):
        print(f"pre-run check: {finding}")
    path = options.log or Path("out") / time.strftime("drive-%Y%m%d-%H%M%S.mcap")
    recorder = Recorder(
        path,
        controller,
        about={
            "scenario": json.dumps(tables),
            "folder": str(folder.resolve()),
            "arm": options.kind,
            "stage": options.stage.value,
        },
        port=options.port,
        translate={"reference": partial(_new_motion, scenario.estimated)},
    )
    with recorder, _connect(options, scenario, load) as arm:
        print(f"log {path}, commands at port {recorder.port}: pinadapt tell {recorder.port} stop")
        ending = RealtimeLoop(
            arm,
            controller,
            scenario.trajectory,
            stage=options.stage,
            safety=safety,
            recorder=recorder,
            start=scenario.start,
            scheduling=Scheduling(core=options.core),
        ).run(options.duration)
    print(ending)
    if options.stage is Stage.ADAPT and ending.state is not None:
        beside = path.with_suffix(".learned.json")
        LearnedParameters.of(controller, ending.state).save(beside)
        print(f"learned parameters in {beside}")
    if any("interrupt" in why for _, _, why in ending.phases):
        return Exit.INTERRUPTED
    return Exit.DIVERGED if ending.failed else Exit.DONE


def _tables(options: Namespace) -> tuple[Tables, Path, Payload | None]:
    """Return the tables of the scenario, the folder of its paths, and the load of a Franka.

    The robot carries the load, whose gravity it compensates itself; the tables say so.

    Raises:
        InputError: the scenario is missing, or has a load already, or its robot no flange.
    """
    tables = FRANKA
    folder = Path()
    if options.file is not None:
        tables = read_tables(options.file, options.set)
        folder = options.file.parent
    elif options.kind != "franka":
        raise ScenarioError(
            "is needed for this arm.",
            where="--scenario",
            hint="`pinadapt init ROBOT` writes one.",
        )
    elif options.set:
        raise ScenarioError("needs --scenario, whose keys it sets.", where="--set")
    if options.load is None:
        return tables, folder, None
    load = made(Payload, _json(options.load, "--load"), "--load")
    if "payload" in tables.get("controller", {}):
        raise ScenarioError(
            "is also given by --load; give only one of them.", where="controller.payload"
        )
    robot = described_robot(parts(at_folder(tables, folder)))
    known = plain(asdict(at_task_frame(load, robot)))
    own = {"controller.payload": known, "controller.compensated": {"payload": known}}
    return with_values(tables, own), folder, load


def _connect(options: Namespace, scenario: Scenario, load: Payload | None) -> Arm:
    """Return the arm of the options.

    Raises:
        InputError: there is none, or it cannot be connected.
    """
    kind = options.kind
    address = options.address
    if kind == "simulated":
        engine = scenario.engine
        make = partial(engine.make, scenario.true.undrawn(), scenario.controller)
        return ProcessArm(make, engine.period(scenario.controller), sensors=scenario.sensors)
    if kind == "moteus":
        from ..realtime.moteus_arm import MoteusArm, Motor

        table = dict(scenario.tables.get("moteus", {}))
        motors = table.pop("motors", None)
        if not isinstance(motors, list):
            raise ScenarioError(
                "is needed: one [[moteus.motors]] with joint and id for each joint.", where="moteus"
            )
        table |= {} if address is None else {"channel": address}
        listed = [made(Motor, each, f"moteus.motors.{k}") for k, each in enumerate(motors)]
        with located("moteus", table, ("robot",)):
            return MoteusArm(scenario.estimated, listed, period=scenario.controller.period, **table)
    if kind == "franka":
        if address is None:
            raise InputError("is needed: the robot's address, such as 172.16.0.2.", where="ADDRESS")
        return FrankaArm(
            address, scenario.estimated, load=load, **given(options, ("recover", *_COLLISION))
        )
    file, _, name = kind.rpartition(":")
    if not Path(file).is_file():
        raise InputError(
            f"there is no arm '{kind}'; expected one of simulated, franka, moteus, and "
            "FILE.py:CLASS, an existing file.",
            where="ARM",
        )
    found = runpy.run_path(file).get(name)
    arm = None if found is None else found(address, scenario.estimated)
    if not isinstance(arm, Arm):
        raise InputError("is not a pinadapt.realtime.Arm.", where=kind)
    return arm


def _json(text: str, where: str) -> Any:
    """Return what a JSON text states.

    Raises:
        InputError: it is not valid JSON.
    """
    try:
        return json.loads(text)
    except ValueError as error:
        raise InputError(f"is not valid JSON: {error}.", where=where) from error


def _new_motion(robot: Robot, table: Any, measurement: Measurement) -> Trajectory:
    """Return the motion of a [trajectory] table, beginning where the arm is."""
    if measurement.x is None:
        measurement = measurement._replace(x=robot.position(measurement.q))
    if robot.contacts:  # it stands elsewhere than at home
        robot = replace(robot, q0=measurement.q)
    return starting_from(
        trajectory_of(dict(mapping(table, "reference")), robot), robot, measurement
    )


# --- replay -------------------------------------------------------------------------------------


def replay_arguments(parser: ArgumentParser) -> None:
    """Add the arguments of ``replay``."""
    parser.add_argument("log", type=Path, metavar="LOG", help="MCAP file of `pinadapt drive`")
    add_settings(parser)


def replay(options: Namespace) -> int:
    """Print the torques of a log beside those that its controller, or another one, computes.

    Return 3 if the same controller computes others, else 0.

    Raises:
        InputError: the log cannot be used, or has no scenario.
    """
    log = CycleLog.read(options.log)
    if "scenario" not in log.about:
        raise InputError(
            "contains no scenario; replay it in Python: CycleLog.read(path).replay(controller).",
            where=options.log,
        )
    tables = with_values(json.loads(log.about["scenario"]), dict(map(setting, options.set)))
    scenario = Scenario.build(tables, Path(log.about["folder"]))
    found = log.replay(scenario.controller)
    if not found.torque.size:
        raise InputError("this log contains no torque of a controller.", where=options.log)
    names = scenario.controller.kinematics.joint_names
    largest = np.abs(found.torque - found.logged).max(axis=0)
    rows = list(zip(names, found.difference, largest, strict=True))
    table = Table(rows, ("[N m, N]", "difference, rms", "largest"))
    print(Report(f"{len(log)} cycles of {options.log}", [table]))
    if found.same:
        print("\nthe same torques, bit for bit")
    elif not options.set:
        print("\nthe torques differ: other versions of the libraries, or another processor?")
        return Exit.DIVERGED
    return Exit.DONE


# --- tell ---------------------------------------------------------------------------------------


def tell_arguments(parser: ArgumentParser) -> None:
    """Add the arguments of ``tell``."""
    parser.add_argument("port", type=int, metavar="PORT", help="of the running loop")
    parser.add_argument("what", choices=COMMANDS, metavar="COMMAND", help=", ".join(COMMANDS))
    parser.add_argument("value", nargs="?", metavar="JSON", help='such as true, or {"mass": 1.0}')


def tell(options: Namespace) -> int:
    """Send a command to a running loop and print its answer.

    Raises:
        InputError: no answer, or the command cannot be read.
    """
    value = None if options.value is None else _json(options.value, "value")
    for key, part in tell_loop(options.port, options.what, value).items():
        print(f"{key}: {part}")
    return Exit.DONE
