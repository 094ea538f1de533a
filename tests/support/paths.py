"""Places in the tree that tests read."""

import importlib.util
from pathlib import Path

ROOT = Path(__file__).parents[2]
ARM4 = ROOT / "tests" / "data" / "arm4.urdf"  # three revolute joints and a slide


def page_module(folder, name):
    """Return a module of the documentation."""
    path = ROOT / "docs" / folder / f"{name}.py"
    spec = importlib.util.spec_from_file_location(name, path)
    found = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(found)
    return found
