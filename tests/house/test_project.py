"""Lines, public names, docstrings and the README keep the rules of the project."""

import importlib
import inspect
import re

import pytest

import pinadapt
from tests.support.paths import ROOT

SOURCE = ROOT / "src" / "pinadapt"


@pytest.mark.parametrize("path", sorted((ROOT / "benchmarks").glob("*.py")), ids=lambda p: p.stem)
def test_benchmarks_can_be_started(path):
    """All that they import from the library, from each other and from the tests exists."""
    importlib.import_module(f"benchmarks.{path.stem}")


def public():
    """Return the public names of the package and their objects."""
    return {name: getattr(pinadapt, name) for name in dir(pinadapt) if not name.startswith("_")}


def test_public_names_resolve():
    names = re.findall(r"import \w+ as (\w+)", (SOURCE / "__init__.pyi").read_text())
    assert len(names) > 40 and sorted(names) == pinadapt.__all__ == dir(pinadapt)
    for name in names:
        assert hasattr(pinadapt, name)
    assert not hasattr(pinadapt, "numpy")
    with pytest.raises(AttributeError, match="Controler") as error:
        _ = pinadapt.Controler
    assert error.value.obj is pinadapt and error.value.name == "Controler"  # as Python suggests by


@pytest.mark.parametrize(
    "name",
    [
        name
        for name, thing in public().items()
        if inspect.isclass(thing) or inspect.isfunction(thing)
    ],
)
def test_public_names_are_documented_and_annotated(name):
    thing = public()[name]
    assert len(inspect.getdoc(thing) or "") > 20
    for label, method in (
        inspect.getmembers(thing, inspect.isfunction) if inspect.isclass(thing) else [(name, thing)]
    ):
        if label.startswith("_") or not (method.__module__ or "").startswith("pinadapt"):
            continue
        assert inspect.getdoc(method), f"{name}.{label}"
        assert "return" in method.__annotations__, f"{name}.{label}"


@pytest.mark.parametrize(
    "law", [law for law in pinadapt.laws.LAWS.values()], ids=list(pinadapt.laws.LAWS)
)
def test_law_docstrings_state_the_proof(law):
    doc = inspect.getdoc(law)
    for heading in ("Law:", "Adaptation:", "Closed loop:", "V:", "Assumptions:"):
        assert heading in doc
    assert re.search(r"(19|20)\d\d", doc)  # a source with a year
