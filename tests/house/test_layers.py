"""Rooms of the package import one way, and neither rooms nor files import in a circle.

Imports inside functions count, and so do those for the type checker alone.
"""

import ast
import importlib

import pytest

from tests.support.paths import ROOT

SOURCE = ROOT / "src" / "pinadapt"
FILES = sorted(SOURCE.rglob("*.py"))


def module_of(path):
    """Return the name of a file's module."""
    parts = path.relative_to(SOURCE.parent).with_suffix("").parts
    return ".".join(parts).removesuffix(".__init__")


# A folder, or a file beside the folders, may import those of the layers before its own, and itself.
LAYERS = [
    {"exceptions", "_version"},
    {"_compiled"},
    {"_checks", "_files", "_kernels", "_table"},
    {"records", "tasks"},
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


def test_every_module_imports():
    for module in set(MODULES) - {"pinadapt.__main__"}:
        importlib.import_module(module)
