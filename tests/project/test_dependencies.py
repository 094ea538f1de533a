"""Dependencies: each is used and has a reason, and each import is of one of them."""

import ast
import re
import sys
from functools import cache

from pinadapt._output import toml
from tests.support.parsed import FILES, parsed
from tests.support.paths import ROOT

TEXT = (ROOT / "pyproject.toml").read_text()
PROJECT = toml.loads(TEXT)["project"]
EXTRAS = PROJECT["optional-dependencies"]
OPTIONAL = (
    "contacts",
    "mujoco",
    "bags",
    "descriptions",
    "franka",
    "moteus",
    "tune",
)  # extras whose packages the library imports
PROVIDED = {
    "pin": {"pinocchio", "coal"},
    "example_robot_data_loaders": {"example_robot_data"},
    "meshcat": {"meshcat", "umsgpack", "IPython"},  # it requires the others
    "numba": {"numba", "llvmlite"},
    "python_can": {"can"},
}


def modules(requirements):
    """Return the modules that packages provide."""
    names = [re.match(r"[\w-]+", line)[0].replace("-", "_") for line in requirements]
    return set().union(*(PROVIDED.get(name, {name}) for name in names))


@cache
def imported():
    """Return the modules of other projects that the library imports, at any place."""
    found = set()
    for path in FILES:
        found |= set(parsed(path).imported)
        for node in parsed(path).imports:
            if isinstance(node, ast.Import):
                found |= {alias.name.partition(".")[0] for alias in node.names}
            elif not node.level:
                found.add(node.module.partition(".")[0])
    return {name for name in found - {"pinadapt", "tomllib"} if name not in sys.stdlib_module_names}


def test_imported_packages_are_declared():
    declared = modules(PROJECT["dependencies"] + [line for e in OPTIONAL for line in EXTRAS[e]])
    assert imported() <= declared


def test_declared_packages_are_imported():
    for name in modules(PROJECT["dependencies"]) - {"llvmlite", "IPython"}:
        assert name in imported()
