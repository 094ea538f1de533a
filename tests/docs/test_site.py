"""Site, citation file, changelog, workflow and hooks agree with the code."""

import re

import pytest

from tests.support.paths import ROOT

DOCS = ROOT / "docs"
PAGES = sorted(path.stem for path in DOCS.glob("*.md"))


@pytest.mark.parametrize("page", [*PAGES, "../CONTRIBUTING", "../CHANGELOG", "../README"])
def test_links_to_files_resolve(page):
    path = DOCS / f"{page}.md"
    built = ("gallery/", "api/")  # by `make docs`
    for target in re.findall(r"\]\(([^)#]+?)(?:#[^)]*)?\)", path.read_text()):
        if "://" not in target and not target.startswith(built):
            assert (path.parent / target).exists(), target
