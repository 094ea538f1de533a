"""The library imports no layer above it, and neither folders nor files import in a circle.

Imports inside functions count, and so do those for the type checker alone.
"""

import ast

import pytest

from tests.support.parsed import FILES, SOURCE, parsed

ABOVE = {"identification", "logs", "scenario", "cli", "sweep", "zoo", "realtime"}


def imports(depth):
    """Return each folder (depth 1) or file (2) of the package, and those that it imports."""
    found = {}
    for path in FILES:
        parts = path.relative_to(SOURCE).with_suffix("").parts
        if parts[0] in ("__init__", "__main__"):
            continue  # they import what users see
        own = found.setdefault(parts[:depth], set())
        for node in parsed(path).imports:
            if isinstance(node, ast.ImportFrom) and node.level:
                base = parts[: len(parts) - node.level]
                modules = [node.module] if node.module else [each.name for each in node.names]
                own |= {(*base, *module.split("."))[:depth] for module in modules}
    return {name: others - {name} for name, others in found.items()}


def test_the_library_imports_no_layer_above_it():
    for (name,), others in imports(1).items():
        if name not in ABOVE:
            assert not {other for (other,) in others} & ABOVE, name


@pytest.mark.parametrize("depth", [1, 2])
def test_nothing_imports_in_a_circle(depth):
    waiting = imports(depth)
    while waiting:
        free = [name for name, others in waiting.items() if not others & set(waiting)]
        assert free, f"among {sorted(waiting)}"
        for name in free:
            del waiting[name]
