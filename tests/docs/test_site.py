"""Site, citation file, changelog, workflow and hooks agree with the code."""

import json
import os
import re
import sys
from importlib.util import module_from_spec, spec_from_file_location
from types import SimpleNamespace

import pytest

import pinadapt
from benchmarks.timing import table_rows
from tests.support.paths import ROOT

DOCS = ROOT / "docs"
PAGES = sorted(path.stem for path in DOCS.glob("*.md"))


def text_of(name):
    """Return the text of a file of the repository."""
    return (ROOT / name).read_text()


def test_versions_agree():
    cited = re.search(r"^version: (.+)$", text_of("CITATION.cff"), re.M)
    assert cited and cited.group(1).strip('"') == pinadapt.__version__
    entry = text_of("src/pinadapt/references.bib").partition("@software{pinadapt,")[2]
    assert f"version = {{{pinadapt.__version__}}}" in entry
    assert f"## {pinadapt.__version__}" in text_of("CHANGELOG.md")


def test_the_front_page_links_to_every_page():
    front = text_of("docs/index.md")
    listed = re.findall(
        r"^([\w/]+)$", "".join(re.findall(r"```{toctree}(.*?)```", front, re.S)), re.M
    )
    assert set(PAGES) - {"index"} == {name for name in listed if "/" not in name}


@pytest.mark.parametrize("page", [*PAGES, "../CONTRIBUTING", "../CHANGELOG", "../README"])
def test_links_to_files_resolve(page):
    path = DOCS / f"{page}.md"
    built = ("gallery/", "api/")  # by `make docs`
    for target in re.findall(r"\]\(([^)#]+?)(?:#[^)]*)?\)", path.read_text()):
        if "://" not in target and not target.startswith(built):
            assert (path.parent / target).exists(), target


def test_the_table_of_laws_has_every_law_measured():
    page = text_of("docs/laws.md")
    assert {row["law"] for row in table_rows("laws")} == set(pinadapt.laws.LAWS)
    for law in pinadapt.laws.LAWS:
        assert f"| `{law}`" in page


def test_the_theory_page_has_every_equation_that_names_a_law():
    theory = text_of("docs/theory.md")
    tags = {int(n) for tag in re.findall(r"\\tag\{WX ([\d, ]+)\}", theory) for n in tag.split(",")}
    assert tags >= {3, 4, 10, 11, 13, 17, 18, 19, 26, 32, 34}
    ours = [int(n) for n in re.findall(r"\\tag\{T (\d+)\}", theory)]
    assert ours == list(range(1, len(ours) + 1))
    assert {int(n) for n in re.findall(r"\(T (\d+)\)", theory)} <= set(ours)


def test_the_workflow_runs_make_targets_on_all_versions_of_python():
    workflow = text_of(".github/workflows/checks.yml")
    targets = re.findall(r"run: make (\w+)", workflow)
    assert set(targets) == {"lint", "test", "docs"}
    assert "run: make ${{ matrix.target }}" in workflow
    for target in [*targets, *re.search(r"target: \[(.+)\]", workflow).group(1).split(", ")]:
        assert re.search(rf"^{target}\b.*:", text_of("Makefile"), re.M)
    least = re.search(r'requires-python = ">=(3\.\d+)"', text_of("pyproject.toml")).group(1)
    matrices = re.findall(r"python-version: (\[.+\])", workflow)
    assert [json.loads(matrix) for matrix in matrices] == [[least, "3.11", "3.12", "3.13"]] * 3


def test_the_hooks_run_the_same_tools_as_lint():
    makefile = text_of("Makefile")
    lint = re.search(r"^lint:.*\n((?:\t.+\n)+)", makefile, re.M).group(1)
    hooks = re.findall(r"entry: \.venv/bin/(.+)", text_of(".pre-commit-config.yaml"))
    strip = re.search(r"^STRIP +:= \$\(BIN\)/(.+)$", makefile, re.M).group(1)
    assert hooks == ["ruff format", "ruff check", "mypy", strip.replace(" ", " --verify ", 1)]
    for run in ("$(BIN)/ruff format", "$(BIN)/ruff check", "$(BIN)/mypy", "$(STRIP) --verify"):
        assert run in lint


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


def to_rst(docstring):
    """Return a docstring as reStructuredText."""
    lines = docstring.split("\n")
    extension("docstrings").to_rst(None, "", "", None, None, lines)
    return "\n".join(lines)


def test_formulas_in_docstrings_are_escaped():
    shown = to_rst("One line.\n\nLaw:   |e| = lambda_ s with ``a|b_``,\n       more.\nV:     e.")
    assert shown.split("\n")[2:] == [
        r":Law: \|e\| = lambda\_ s with ``a|b_``,",
        "       more.",
        ":V: e.",
    ]


@pytest.mark.slow
def test_the_gallery_draws_the_shapes_of_the_descriptions(tmp_path, monkeypatch):
    spec = spec_from_file_location("gallery", DOCS / "gallery.py")
    gallery = module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "gallery", gallery)
    spec.loader.exec_module(gallery)
    drawn = {}
    close = gallery.plt.close
    monkeypatch.setattr(gallery.plt, "close", lambda figure: drawn.update(figure=figure))
    case = gallery.zoo_case("scara")
    monkeypatch.setattr(gallery, "DURATION", 0.2)
    runs = {"not adapted": gallery.simulated(case, "none")}
    runs["adapted"] = runs["not adapted"]
    gallery.draw(case, runs, tmp_path / "scara.png")
    space, panel = drawn["figure"].axes
    assert panel.get_xlim() == (0.0, pytest.approx(0.195))
    body, colours = gallery.drawn(case.true, runs["adapted"].q[-1])
    assert len(space.collections[0].get_facecolor()) == len(body) == len(colours)
    low, high = body.min(axis=(0, 1)), body.max(axis=(0, 1))
    shown = [space.get_xlim(), space.get_ylim(), space.get_zlim()]
    for (lower, upper), first, last in zip(shown, low, high, strict=True):
        assert lower <= first + 1e-9 and upper >= last - 1e-9
    close(drawn["figure"])
    assert (
        len(gallery.triangles(pinadapt.load("solo8_fl_leg").visual.geometryObjects[-1])) > 100
    )  # a mesh
