"""Site, citation file, changelog, workflow and hooks agree with the code."""

import re

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
