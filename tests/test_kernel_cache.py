"""Machine code on disk: kept, repaired where damaged, done without where none can be written."""

import os
import subprocess
import sys

import pytest

KERNEL = """
from pinadapt._compiled import compiled

@compiled("void(f8[:], f8[:])")
def double(x, y):
    for i in range(len(x)):
        y[i] = 2.0 * x[i]
"""
MAIN = """
import sys
import numpy as np
from pinadapt import _compiled

_compiled._waiting.clear()
import kernel

_compiled.compile_all()
y = np.zeros(2)
kernel.double(np.array([1.0, 2.0]), y)
assert y.tolist() == [2.0, 4.0]
print(sum(kernel.double.stats.cache_hits.values()))
"""


@pytest.fixture
def hits(tmp_path):
    """Return a function that runs a kernel in a new process and returns how often it was found."""
    (tmp_path / "kernel.py").write_text(KERNEL)
    nowhere = os.devnull + "/nowhere"
    user = {"HOME": nowhere, "XDG_CACHE_HOME": nowhere, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}

    def run(**others):
        environment = {**os.environ, "PYTHONPATH": path(tmp_path), **user, **others}
        command = [sys.executable, "-B", "-c", MAIN]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=100)
        assert done.returncode == 0, done.stderr
        return int(done.stdout)

    return run


def path(folder):
    return os.pathsep.join([str(folder), os.environ.get("PYTHONPATH", "")])


def test_a_damaged_file_is_replaced(tmp_path, hits):
    hits()
    for suffix, content in (("nbi", b""), ("nbc", b"not machine code")):
        (damaged,) = (tmp_path / "cache").rglob(f"*.{suffix}")
        damaged.write_bytes(content)
        assert (hits(), hits(), hits()) == (0, 0, 1)  # emptied, written, found


def test_a_file_that_cannot_be_written_is_done_without(tmp_path, hits):
    hits()
    (index,) = (tmp_path / "cache").rglob("*.nbi")
    index.unlink()
    index.mkdir()
    assert hits() == 0


def test_no_folder_for_the_cache(tmp_path, hits):
    (tmp_path / "__pycache__").write_text("")
    assert hits(NUMBA_CACHE_DIR=os.devnull + "/nowhere") == 0
