"""The project keeps its own rules: imports, sizes, names, documentation, the README."""

import ast
import importlib
import inspect
import re
from pathlib import Path

import pytest

import pinadapt

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src" / "pinadapt"
FILES = sorted(SOURCE.rglob("*.py"))

# A folder may import those of the layers before its own, and itself.
LAYERS = [
    {"exceptions", "_checks", "_compiled", "_kernels", "_toml", "_version"},
    {"records", "tasks"},
    {"trajectories"},
    {"robot"},
    {"models"},
    {"signals"},
    {"filters", "adaptation"},
    {"laws"},
    {"controller"},
    {"tuning"},
    {"plants"},
    {"plots"},
    {"rollout"},
    {"simulation", "view"},
    {"scenario", "zoo"},
    {"cli"},
]
LAYER = {name: level for level, names in enumerate(LAYERS) for name in names}


def imports_of(path):
    """Return the folders of pinadapt that a file imports, at its top or inside its functions."""
    package = ["pinadapt", *path.relative_to(SOURCE).parent.parts]
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = package[: len(package) - node.level + 1]
            target = base + (node.module or "").split(".") if node.module else base
            names = [target[1]] if len(target) > 1 else [alias.name for alias in node.names]
            yield from (name for name in names if name in LAYER)


@pytest.mark.parametrize(
    "path", [p for p in FILES if p.parent != SOURCE], ids=lambda p: str(p.relative_to(SOURCE))
)
def test_arrows_run_one_way(path):
    folder = path.relative_to(SOURCE).parts[0]
    for imported in imports_of(path):
        assert imported == folder or LAYER[imported] < LAYER[folder], f"{path} imports {imported}"


def test_every_folder_has_a_layer():
    assert {p.name for p in SOURCE.iterdir() if p.is_dir() and p.name != "__pycache__"} <= set(
        LAYER
    )


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(SOURCE)))
def test_files_and_functions_stay_small(path):
    text = path.read_text()
    assert text.count("\n") <= 400
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef):
            doc = ast.get_docstring(node, clean=False)
            assert node.end_lineno - node.lineno - (doc.count("\n") + 1 if doc else 0) <= 50, (
                node.name
            )


def public():
    """Return the public names of the package and their objects."""
    return {name: getattr(pinadapt, name) for name in dir(pinadapt) if not name.startswith("_")}


def test_public_names_resolve():
    text = (SOURCE / "__init__.py").read_text()
    names = re.findall(r"import \w+ as (\w+)", text)
    assert len(names) > 40
    for name in names:
        assert hasattr(pinadapt, name)


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


def test_readme_snippet_runs(tmp_path, monkeypatch, capsys):
    snippet = re.search(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.S).group(1)
    monkeypatch.chdir(tmp_path)
    scope = {}
    exec(snippet, scope)
    assert scope["rollout"].diverged is None
    assert scope["rollout"].summary()["max_error_last"] < 2e-3
    assert "error, last 10 %" in capsys.readouterr().out
    assert (tmp_path / "out" / "error.png").stat().st_size > 10_000


def test_types_are_declared():
    assert (SOURCE / "py.typed").is_file()


def test_readme_stays_short():
    assert len((ROOT / "README.md").read_text().splitlines()) <= 120


def test_every_module_imports():
    for path in FILES:
        module = ".".join(path.relative_to(SOURCE.parent).with_suffix("").parts).removesuffix(
            ".__init__"
        )
        if not module.endswith("__main__"):
            importlib.import_module(module)
