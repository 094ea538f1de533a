"""Machine code on disk: kept, repaired where damaged, done without where none can be written."""

import json
import os
import subprocess
import sys
from textwrap import dedent

import numpy as np
import pytest

pytestmark = pytest.mark.slow

KERNEL = """
from pinadapt._compiled import compiled

@compiled("void(f8[:], f8[:])")
def double(x, y):
    for i in range(len(x)):
        y[i] = 2.0 * x[i]
"""
HITS = """
import importlib, os
from pathlib import Path
import numpy as np
from numba import config
from pinadapt import _compiled

import kernel

def hits():
    _compiled._waiting.clear()
    importlib.reload(kernel)
    _compiled.compile_all()
    y = np.zeros(2)
    kernel.double(np.array([1.0, 2.0]), y)
    assert y.tolist() == [2.0, 4.0]
    return sum(_compiled.kernels["kernel.double"].stats.cache_hits.values())

def only(pattern):
    (file,) = Path("cache").rglob(pattern)
    return file
"""
NOWHERE = os.devnull + "/nowhere"


@pytest.fixture
def run(tmp_path):
    """Return a function that runs code in a new process, ``hits()`` as often as it compiles."""
    (tmp_path / "kernel.py").write_text(KERNEL)
    path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])

    def run(code, cache):
        own = {"PYTHONPATH": path, "HOME": NOWHERE, "XDG_CACHE_HOME": NOWHERE}
        done = subprocess.run(
            [sys.executable, "-B", "-c", HITS + dedent(code)],
            env={**os.environ, **own, "NUMBA_CACHE_DIR": cache},
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=100,
        )
        assert done.returncode == 0, done.stderr

    return run


def test_a_damaged_file_is_replaced_and_one_that_cannot_be_written_done_without(run):
    """Then no folder can be made, neither in the user's cache nor beside the source."""
    run(
        """
        assert (hits(), hits()) == (0, 1)
        for suffix in ("nbi", "nbc"):
            for content in (b"", b"not machine code"):
                only(f"*.{suffix}").write_bytes(content)
                assert (hits(), hits(), hits()) == (0, 0, 1)  # emptied, written, found
        index = only("*.nbi")
        index.unlink()
        index.mkdir()
        assert (hits(), hits()) == (0, 0)

        Path("__pycache__").write_text("")
        os.environ["NUMBA_CACHE_DIR"] = os.devnull + "/nowhere"
        config.reload_config()
        assert (hits(), hits()) == (0, 0)
        """,
        cache="cache",
    )


TORQUE = """
import numpy as np, pinadapt as pa
robot = pa.load("planar_2r")
control = pa.make_controller(robot)
measurement = pa.plants.PinocchioPlant(robot).measurement(robot.q0, np.array([0.1, -0.2]))
desired = pa.Desired(measurement.x + 0.01, np.zeros(2), np.zeros(2))
torque = control.step(control.init(measurement), measurement, desired, 1e-3)[0].tolist()
"""


def test_without_compilation_the_same_torques_come_out():
    interpreted = subprocess.run(
        [sys.executable, "-c", TORQUE + "print(torque)"],
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    exec(TORQUE, compiled := {})
    np.testing.assert_allclose(compiled["torque"], json.loads(interpreted), rtol=1e-12)
