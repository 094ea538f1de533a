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


ABOVE = {"identification", "logs", "scenario", "cli", "sweep", "zoo", "realtime"}


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


def test_the_library_imports_no_layer_above_it():
    for module in sorted(set(MODULES) - ENTRIES):
        if module.split(".")[1] not in ABOVE:
            for imported in imports_of(MODULES[module]):
                assert imported.split(".")[1] not in ABOVE, f"{module} imports {imported}"


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
    imports = {name.split(".")[1]: set() for name in set(MODULES) - ENTRIES}
    for module in set(MODULES) - ENTRIES:
        room = module.split(".")[1]
        imports[room] |= {name.split(".")[1] for name in imports_of(MODULES[module])} - {room}
    assert not circles(imports), [sorted(circle) for circle in circles(imports)]
