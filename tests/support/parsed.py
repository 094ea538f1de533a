"""What the files of the library import and define, each parsed once for all tests."""

import ast
from functools import cache
from pathlib import Path
from typing import NamedTuple

from tests.support.paths import ROOT

SOURCE = ROOT / "src" / "pinadapt"
FILES = sorted(SOURCE.rglob("*.py"))


class Parsed(NamedTuple):
    """Parts of a file, at any depth of it.

    Attributes:
        imports: its statements that import, those inside functions and for type checkers too.
        imported: constants that are given to ``import_module``.
        classes: names of its classes.
        sources: constants in what is assigned to ``sources``, of classes and of objects.
    """

    imports: list[ast.Import | ast.ImportFrom]
    imported: list[object]
    classes: list[str]
    sources: list[object]


@cache
def parsed(path: Path) -> Parsed:
    """Return the parts of a file."""
    found = Parsed([], [], [], [])
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import | ast.ImportFrom):
            found.imports.append(node)
        elif isinstance(node, ast.Call):
            if last_name(node.func) == "import_module":
                found.imported.extend(a.value for a in node.args if isinstance(a, ast.Constant))
        elif isinstance(node, ast.ClassDef):
            found.classes.append(node.name)
        elif isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None:
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            if "sources" in map(last_name, targets):
                inside = ast.walk(node.value)
                found.sources.extend(c.value for c in inside if isinstance(c, ast.Constant))
    return found


def last_name(node: ast.expr) -> str | None:
    """Return c of ``c`` and of ``a.b.c``, None of anything else."""
    return getattr(node, "attr", None) or getattr(node, "id", None)
