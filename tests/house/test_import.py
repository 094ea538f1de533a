"""Importing the library, or listing the catalogue, loads nothing that only other work needs."""

import subprocess
import sys

import pytest

HEAVY = (
    "scipy",
    "matplotlib",
    "meshcat",
    "numba",
    "pydantic",
    "tqdm",
    "umsgpack",
    "example_robot_data",
    "mujoco",
)


def loaded(code):
    """Return the top-level modules that a new process holds after running code."""
    done = subprocess.run(
        [sys.executable, "-c", f"{code}\nimport sys; print(*sys.modules, file=sys.stderr)"],
        capture_output=True,
        text=True,
        timeout=100,
        check=True,
    )
    return {name.partition(".")[0] for name in done.stderr.split()}


@pytest.mark.parametrize(
    ("code", "absent"),
    [
        ("import pinadapt", (*HEAVY, "pinocchio", "numpy")),
        ("from pinadapt.cli import main; main(['robots'])", HEAVY),
        ("import pinadapt; pinadapt.load('planar_2r')", HEAVY),
        ("from pinadapt.sweep.execution import run_case", ("matplotlib", "scipy", "mujoco")),
    ],
)
def test_slow_modules_wait_until_they_are_needed(code, absent):
    modules = loaded(code)
    assert ("pinocchio" in modules) is ("pinocchio" not in absent)
    assert not modules & set(absent)
