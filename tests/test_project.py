"""The project keeps its own rules: imports, sizes, names, documentation, the README."""

import ast
import importlib
import inspect
import re
import subprocess
import sys
from pathlib import Path

import pytest

import pinadapt

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src" / "pinadapt"
FILES = sorted(SOURCE.rglob("*.py"))


def module_of(path):
    """Return the name of a file's module."""
    parts = path.relative_to(SOURCE.parent).with_suffix("").parts
    return ".".join(parts).removesuffix(".__init__")


# A folder, or a file beside the folders, may import those of the layers before its own, and itself.
LAYERS = [
    {"exceptions", "_borrowed", "_version", "reference"},
    {"_compiled", "bibliography"},
    {"_checks", "_files", "_kernels", "_table", "_toml"},
    {"records", "sensing", "tasks"},
    {"trajectories"},
    {"description"},
    {"robot"},
    {"models", "logs"},
    {"adaptation"},
    {"signals"},
    {"filters"},
    {"laws"},
    {"controller"},
    {"tuning", "citation"},
    {"plants"},
    {"information"},
    {"plots", "view"},
    {"rollout"},
    {"simulation"},
    {"excitation"},
    {"scenario", "zoo", "identification"},
    {"cli"},
]
LAYER = {name: level for level, names in enumerate(LAYERS) for name in names}


MODULES = {module_of(path): path for path in FILES}
ENTRIES = {"pinadapt", "pinadapt.__main__"}  # they import what users see


def imports_of(path):
    """Return the modules of pinadapt that a file imports, at its top or inside its functions."""
    package = ["pinadapt", *path.relative_to(SOURCE).parent.parts]
    for node in executed(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = package[: len(package) - node.level + 1]
            target = ".".join([*base, node.module] if node.module else base)
            names = [f"{target}.{alias.name}" for alias in node.names]
            yield from (name if name in MODULES else target for name in names)


def executed(tree):
    """Yield the nodes of a file that run, so not those for the type checker alone."""
    yield tree
    for node in ast.iter_child_nodes(tree):
        if not (isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"):
            yield from executed(node)


@pytest.mark.parametrize("module", sorted(set(MODULES) - ENTRIES))
def test_arrows_run_one_way(module):
    folder = module.split(".")[1]
    for imported in imports_of(MODULES[module]):
        target = imported.split(".")[1]
        assert target == folder or LAYER[target] < LAYER[folder], f"{module} imports {imported}"


def test_no_modules_import_each_other_in_a_circle():
    waiting = {module: set(imports_of(path)) - {module} for module, path in MODULES.items()}
    while ready := {module for module, needs in waiting.items() if not needs & set(waiting)}:
        waiting = {module: needs for module, needs in waiting.items() if module not in ready}
    assert not waiting, f"a circle in {sorted(waiting)}"


def test_every_folder_has_a_layer():
    assert {module.split(".")[1] for module in set(MODULES) - ENTRIES} == set(LAYER)


@pytest.mark.parametrize("folder", ["src", "tests", "benchmarks"])
def test_lines_are_short(folder):
    long = [
        f"{path.relative_to(ROOT)}:{number}"
        for path in sorted((ROOT / folder).rglob("*.py"))
        for number, line in enumerate(path.read_text().splitlines(), 1)
        if len(line) > 100
    ]
    assert not long


@pytest.mark.parametrize("path", sorted((ROOT / "benchmarks").glob("*.py")), ids=lambda p: p.stem)
def test_benchmarks_can_be_started(path):
    """What they take from the library, from each other and from the tests is there."""
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


def test_a_name_is_its_thing_also_after_a_module_of_that_name_was_imported():
    code = "import pinadapt.citation; assert callable(pinadapt.citation), pinadapt.citation"
    subprocess.run([sys.executable, "-c", code], check=True, timeout=100)


@pytest.mark.parametrize(
    "name",
    [
        name
        for name, thing in public().items()
        if inspect.isclass(thing) or inspect.isfunction(thing)
    ],
)
def test_public_things_are_documented_and_annotated(name):
    thing = public()[name]
    assert len(inspect.getdoc(thing) or "") > 20
    for label, method in (
        inspect.getmembers(thing, inspect.isfunction) if inspect.isclass(thing) else [(name, thing)]
    ):
        if label.startswith("_") or not (method.__module__ or "").startswith("pinadapt"):
            continue
        assert inspect.getdoc(method), f"{name}.{label}"
        assert "return" in method.__annotations__, f"{name}.{label}"


@pytest.mark.parametrize("law", [law for law in pinadapt.LAWS.values()], ids=list(pinadapt.LAWS))
def test_law_docstrings_state_the_proof(law):
    doc = inspect.getdoc(law)
    for heading in ("Law:", "Adaptation:", "Closed loop:", "V:", "Assumptions:"):
        assert heading in doc
    assert re.search(r"(19|20)\d\d", doc)  # a source with a year


def test_types_are_declared():
    assert (SOURCE / "py.typed").is_file()


def test_readme_stays_short():
    assert len((ROOT / "README.md").read_text().splitlines()) <= 100


def test_the_readme_shows_a_light_moving_picture():
    (name,) = re.findall(r"!\[[^\]]+\]\(([^)]+)\)", (ROOT / "README.md").read_text())
    assert (ROOT / name).stat().st_size <= 3e6
    assert (ROOT / name).read_bytes().count(b"NETSCAPE2.0") == 1  # played over and over


def test_every_module_imports():
    for module in set(MODULES) - {"pinadapt.__main__"}:
        importlib.import_module(module)
