"""Files that are damaged in a thousand ways: read, or refused with a typed error that names them.

Further tests of files: wrong numbers and words in scenarios,
``tests/project/test_hostile_input.py``; a process killed while it writes,
``tests/cli/test_interrupted.py`` and ``test_output_files.py``. The network:
``tests/view/test_live.py`` and ``tests/realtime/test_recorder.py``.
"""

import random
import re
import shutil
import warnings

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.controller import LearnedParameters
from pinadapt.sweep.table import CaseTable
from tests.logs.test_logs import columns_of, write_bag, write_csv
from tests.support.chains import catalogue_robot
from tests.support.loops import run
from tests.support.paths import ROOT
from tests.support.recorded import recorded

pytestmark = pytest.mark.slow

NUMBERS = b"0 -1 1e308 nan inf 1e-320 999999999999 9e99 true 1,2 [1] null 0x10 1_0".split()
MARKS = [*b"< > / \" ' \\ & \x00 \xff\xfe ${ } $( { [ ] # = ,".split(), b"\n", b"[" * 5000]
LOGS = "a.csv", "a.npz", "a.bag", "sqlite3", "mcap"


@pytest.fixture(scope="module")
def robot():
    return catalogue_robot("ur5")


@pytest.fixture(scope="module")
def planar():
    return pa.load("planar_2r")


@pytest.fixture(scope="module")
def whole(tmp_path_factory, robot, planar):
    """Return kind -> the bytes of its files, and a function that reads them from a folder."""
    log = recorded("ur5", duration=1.2, dt=1e-2, rate=10.0)
    folder = tmp_path_factory.mktemp("a")
    write_csv(folder / "a.csv", columns_of(log, range(6)))
    arrays = {"t": log.t, "q": log.q, "v": log.v, "tau": log.tau, "x": log.x, "x_time": log.x_time}
    np.savez(folder / "a.npz", joint_names=np.array(robot.joint_names), **arrays)
    run("planar_2r", duration=1.2).save(folder / "run")
    for kind in ("a.bag", "sqlite3", "mcap"):
        write_bag(folder / kind, "ros1" if kind == "a.bag" else kind, log, robot.joint_names)
    controller = pa.make_controller(planar, adaptation="natural")
    state = controller.init(pa.plants.PinocchioPlant(planar).measure())
    LearnedParameters.of(controller, state).save(folder / "a.json")
    table = CaseTable([{"case": 0, "seed": 1, "x": 1.5}, {"case": 1, "seed": 2, "x": 2.5}])
    table.save(folder / "table.csv")
    arm = (ROOT / "tests" / "data" / "arm4.urdf").read_text()
    (folder / "a.urdf").write_text(arm)
    (folder / "a.xml").write_text(planar.mjcf())
    readers = {
        **dict.fromkeys(LOGS, lambda path: pa.read_log(path, robot)),
        "run": lambda path: pa.read_log(path, planar),
        "a.json": lambda path: LearnedParameters.load(path).start(controller),
        "table.csv": CaseTable.load,
        "a.urdf": pa.load,
        "a.xml": pa.load,
    }
    return folder, readers


def damaged(data, rng):
    """Return bytes with one or three faults: flipped, cut, repeated, or other numbers and marks."""
    data = bytearray(data)
    for _ in range(rng.choice([1, 3])):
        at = rng.randrange(len(data))
        kind = rng.randrange(5)
        if kind == 0:
            data[at] = rng.randrange(256)
        elif kind == 1:
            del data[at + 1 :]
        elif kind == 2:
            data[at:at] = data[at : at + 200] * rng.choice([1, 50])
        elif kind == 3:
            data[at:at] = rng.choice(MARKS)
        else:
            found = [m.span() for m in re.finditer(rb"\d+\.?\d*", bytes(data[:50_000]))]
            data[slice(*rng.choice(found or [(at, at)]))] = rng.choice(NUMBERS)
    return bytes(data)


@pytest.mark.parametrize("kind", [*LOGS, "run", "a.json", "table.csv", "a.urdf", "a.xml"])
def test_a_damaged_file_is_read_or_refused(kind, whole, tmp_path):
    folder, readers = whole
    rng = random.Random(kind)
    refused = 0
    source = folder / kind
    copy = tmp_path / kind
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        readers[kind](source)
        for _ in range(15):
            if source.is_dir():
                shutil.copytree(source, copy, dirs_exist_ok=True)
                file = rng.choice(sorted(source.iterdir()))
            else:
                file = source
            data = file.read_bytes()
            (copy / file.name if source.is_dir() else copy).write_bytes(damaged(data, rng))
            try:
                readers[kind](copy)
            except pa.InputError as error:
                refused += 1
                assert str(error)
    assert refused > 0
