"""Rooms of the package import one way, and neither rooms nor files import in a circle.

Imports inside functions count, and so do those for the type checker alone.
"""

import ast
from functools import cache

from tests.support.parsed import FILES, SOURCE, parsed


def module_of(path):
    """Return the name of a file's module."""
    parts = path.relative_to(SOURCE.parent).with_suffix("").parts
    return ".".join(parts).removesuffix(".__init__")


# A folder, or a file beside the folders, may import those of the layers before its own, and itself.
LAYERS = [
    {"exceptions", "_version"},
    {"_compiled"},
    {"_checks", "_kernels", "_output"},
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
    {"tuning", "citation", "reference"},
    {"plants"},
    {"information"},
    {"plots", "view"},
    {"rollout"},
    {"simulation"},
    {"excitation", "realtime"},
    {"scenario", "identification"},
    {"sweep"},
    {"zoo"},
    {"cli"},
]
LAYER = {name: level for level, names in enumerate(LAYERS) for name in names}


MODULES = {module_of(path): path for path in FILES}
ENTRIES = {"pinadapt", "pinadapt.__main__"}  # they import what users see


@cache
def imports_of(path):
    """Return the modules of pinadapt that a file imports: anywhere, also for the type checker."""
    return set(_imports_of(path))


def _imports_of(path):
    package = ["pinadapt", *path.relative_to(SOURCE).parent.parts]
    for node in parsed(path).imports:
        if isinstance(node, ast.ImportFrom) and node.level:
            base = package[: len(package) - node.level + 1]
            target = ".".join([*base, node.module] if node.module else base)
            names = [f"{target}.{alias.name}" for alias in node.names]
            yield from (name if name in MODULES else target for name in names)


def test_arrows_run_one_way():
    for module in sorted(set(MODULES) - ENTRIES):
        folder = module.split(".")[1]
        for imported in imports_of(MODULES[module]):
            target = imported.split(".")[1]
            assert target == folder or LAYER[target] < LAYER[folder], f"{module} imports {imported}"


def circles(imports):
    """Return the sets of names (of modules, or of rooms) that import each other in a circle."""
    reached = {}
    for name in imports:
        waiting, found = [name], set()
        while waiting:
            new = imports.get(waiting.pop(), set()) - found
            found |= new
            waiting.extend(new)
        reached[name] = found
    return {
        frozenset(other for other in found if name in reached.get(other, ()))
        for name, found in reached.items()
        if name in found
    }


def test_no_files_import_each_other_in_a_circle():
    imports = {module: imports_of(path) - {module} for module, path in MODULES.items()}
    assert not circles(imports), [sorted(circle) for circle in circles(imports)]


def test_no_rooms_import_each_other_in_a_circle():
    imports = {room: set() for room in LAYER}
    for module in set(MODULES) - ENTRIES:
        room = module.split(".")[1]
        imports[room] |= {name.split(".")[1] for name in imports_of(MODULES[module])} - {room}
    assert not circles(imports), [sorted(circle) for circle in circles(imports)]
