"""Lines, public names, docstrings and the README keep the rules of the project."""

import importlib
import re

import pytest

import pinadapt
from tests.support.paths import ROOT

SOURCE = ROOT / "src" / "pinadapt"


@pytest.mark.parametrize("path", sorted((ROOT / "benchmarks").glob("*.py")), ids=lambda p: p.stem)
def test_benchmarks_can_be_started(path):
    """All that they import from the library, from each other and from the tests exists."""
    importlib.import_module(f"benchmarks.{path.stem}")


def test_public_names_resolve():
    names = re.findall(r"import \w+ as (\w+)", (SOURCE / "__init__.pyi").read_text())
    assert len(names) > 40 and sorted(names) == pinadapt.__all__ == dir(pinadapt)
    for name in names:
        assert hasattr(pinadapt, name)
    assert not hasattr(pinadapt, "numpy")
    with pytest.raises(AttributeError, match="Controler") as error:
        _ = pinadapt.Controler
    assert error.value.obj is pinadapt and error.value.name == "Controler"  # as Python suggests by
