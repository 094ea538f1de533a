"""Machine code on disk: kept, repaired where damaged, done without where none can be written."""

import importlib
import os
import sys
from pathlib import Path

import numpy as np
import pytest
from numba import config

import pinadapt as pa
from pinadapt import _compiled

pytestmark = pytest.mark.slow

KERNEL = """
from pinadapt._compiled import Vector, compiled

@compiled()
def double(x: Vector, y: Vector) -> None:
    for i in range(len(x)):
        y[i] = 2.0 * x[i]
"""
NOWHERE = os.devnull + "/nowhere"


@pytest.fixture
def fresh(tmp_path, monkeypatch):
    """Return a function that has a kernel compiled or loaded anew, in a folder without any yet."""
    (tmp_path / "only_kernel.py").write_text(KERNEL)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    monkeypatch.setattr(_compiled, "kernels", {})
    for name in ("HOME", "XDG_CACHE_HOME"):
        monkeypatch.setenv(name, NOWHERE)

    def fresh(cache):
        """Return the module, whose kernel's cache is in this folder, if it can be made."""
        monkeypatch.setenv("NUMBA_CACHE_DIR", cache)
        config.reload_config()
        sys.modules.pop("only_kernel", None)
        return importlib.import_module("only_kernel")

    yield fresh
    monkeypatch.undo()
    config.reload_config()
    sys.modules.pop("only_kernel", None)


def test_a_damaged_file_is_replaced_and_one_that_cannot_be_written_done_without(fresh):
    """Then no folder can be made, neither in the user's cache nor beside the source."""

    def hits(cache="cache"):
        """Return how often the kernel was found on disk, and what compiles it if not."""
        kernel = fresh(cache)
        kernel.double(np.array([1.0, 2.0]), y := np.zeros(2))
        assert y.tolist() == [2.0, 4.0]
        return sum(_compiled.kernels["only_kernel.double"].stats.cache_hits.values())

    def only(pattern):
        (file,) = Path("cache").rglob(pattern)
        return file

    assert (hits(), hits()) == (0, 1)
    for suffix in ("nbi", "nbc"):
        only(f"*.{suffix}").write_bytes(b"not machine code")
        assert (hits(), hits(), hits()) == (0, 0, 1)  # emptied, written, found
    index = only("*.nbi")
    index.unlink()
    index.mkdir()
    assert (hits(), hits()) == (0, 0)

    Path("__pycache__").write_text("")
    assert (hits(NOWHERE), hits(NOWHERE)) == (0, 0)


def test_without_compilation_the_same_torques_come_out(monkeypatch):
    robot = pa.load("planar_2r")
    measurement = pa.plants.PinocchioPlant(robot).measurement(robot.q0, np.array([0.1, -0.2]))
    desired = pa.Desired(measurement.x + 0.01, np.zeros(2), np.zeros(2))
    torques = []
    calls = set()

    def counted(name, function):
        def call(*arguments):
            calls.add(name)
            return function(*arguments)

        return call

    for interpreted in (False, True):
        if interpreted:
            for name, dispatcher in _compiled.kernels.items():
                python = dispatcher.py_func
                module = python.__globals__
                monkeypatch.setitem(module, python.__name__, counted(name, python))
        control = pa.make_controller(robot)
        state = control.init(measurement)
        torques.append(control.step(state, measurement, desired, 1e-3)[0])
    np.testing.assert_allclose(*torques, rtol=1e-12)
    assert len(calls) > 5
