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
# what one process does, one after the other, and what is not loaded after each
STEPS = {
    "import pinadapt; dir(pinadapt)": (
        *HEAVY,
        "pinocchio",
        "numpy",
        "pinadapt.laws",
        "pinadapt.plants",
    ),
    "from pinadapt.cli import main; main(['robots'])": HEAVY,
    "pinadapt.load('planar_2r')": (*HEAVY, "pinadapt.citation"),
    "import pinadapt.citation; assert callable(pinadapt.citation)": HEAVY,
    "pinadapt.laws.SlotineLi, pinadapt.trajectories.Circle": HEAVY,
    "from pinadapt.sweep.execution import run_case": ("matplotlib", "scipy", "mujoco"),
    "from pinadapt.plots import draw_all": (),
}


@pytest.fixture(scope="module")
def loaded():
    """Return the modules that a new process holds after each step."""
    said = "print(*sys.modules, file=sys.stderr)"
    code = "\n".join(["import sys", *(f"{step}\n{said}" for step in STEPS)])
    done = subprocess.run(
        [sys.executable, "-c", code],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        timeout=100,
    )
    assert done.returncode == 0, done.stderr[-1000:]
    return dict(zip(STEPS, map(str.split, done.stderr.splitlines()), strict=True))


@pytest.mark.parametrize("step", STEPS)
def test_slow_modules_wait_until_they_are_needed(step, loaded):
    """Nor does a module of that name hide ``pinadapt.citation``."""
    assert ("pinocchio" in loaded[step]) is ("pinocchio" not in STEPS[step])
    assert not set(loaded[step]) & set(STEPS[step])
