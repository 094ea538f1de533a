"""Site, citation file, changelog, workflow and hooks agree with the code."""

import os
import re
from importlib.util import module_from_spec, spec_from_file_location
from types import SimpleNamespace

import pytest

from tests.support.paths import ROOT

DOCS = ROOT / "docs"
PAGES = sorted(path.stem for path in DOCS.glob("*.md"))


def text_of(name):
    """Return the text of a file of the repository."""
    return (ROOT / name).read_text()


@pytest.mark.parametrize("page", [*PAGES, "../CONTRIBUTING", "../CHANGELOG", "../README"])
def test_links_to_files_resolve(page):
    path = DOCS / f"{page}.md"
    built = ("gallery/", "api/")  # by `make docs`
    for target in re.findall(r"\]\(([^)#]+?)(?:#[^)]*)?\)", path.read_text()):
        if "://" not in target and not target.startswith(built):
            assert (path.parent / target).exists(), target


def test_the_theory_page_has_every_equation_that_names_a_law():
    theory = text_of("docs/theory.md")
    tags = {int(n) for tag in re.findall(r"\\tag\{WX ([\d, ]+)\}", theory) for n in tag.split(",")}
    assert tags >= {3, 4, 10, 11, 13, 17, 18, 19, 26, 32, 34}
    ours = [int(n) for n in re.findall(r"\\tag\{T (\d+)\}", theory)]
    assert ours == list(range(1, len(ours) + 1))
    assert {int(n) for n in re.findall(r"\(T (\d+)\)", theory)} <= set(ours)


def extension(name):
    """Return a module of docs/_ext."""
    spec = spec_from_file_location(name, DOCS / "_ext" / f"{name}.py")
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_an_executed_notebook_is_shown_and_not_run_again_unless_a_source_is_newer(
    tmp_path, monkeypatch
):
    executed, config = extension("executed"), SimpleNamespace()
    monkeypatch.setattr(executed, "ROOT", tmp_path)
    paths = [
        tmp_path / name for name in ("src/a.py", "notebooks/b.ipynb", "build/notebooks/b.ipynb")
    ]
    for time, path in enumerate(paths):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(path.parent.name)
        os.utime(path, (time, time))

    def shown():
        source = ["without outputs"]
        executed.take_outputs(None, "notebooks/b", source)
        executed.leave_out(None, config)
        assert config.nb_execution_excludepatterns == (
            ["notebooks/b.ipynb"] if source != ["without outputs"] else []
        )
        return source

    assert shown() == ["notebooks"]
    for path in paths[:2]:
        os.utime(path, (3, 3))
        assert shown() == ["without outputs"]
        os.utime(path, (0, 0))
    paths[2].unlink()
    assert shown() == ["without outputs"]
