"""The notebooks run from top to bottom and say what they print; the tree holds no outputs."""

import re

import pytest

from tests.support.paths import ROOT

NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
KERNEL = {"kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"}}

# nbformat is imported where it is used: it takes seconds, and every process collects this file.

# What the text around the cells relies on; more of it is asserted in the cells themselves.
PRINTED = {
    "01_quickstart": ["same as the simulation: True", "the last body: 2.3"],
    "02_the_paper": ["ended at 34 ms", "no longer positive definite", "largest difference"],
    "03_regressors": ["rank 43 of 70", "translations: 14 of 21"],
    "04_tool_load_camera": ["frames taken for now: lost", "frames up to 93.3 ms old"],
    "05_unknown_lengths": ["60 parameters", "56 parameters", "no V"],
    "06_physical_consistency": ["gradient (18): det M_hat", "no longer positive definite"],
    "07_laws_compared": ["times closer by adaptation"],
    "08_your_own_urdf": ["follows: ", "all limits kept", 'law = "separation"', "'flange'?"],
    "09_your_own_law": ["deg at the end", "largest rise in a sample -"],
}
ANIMATED = ("01_quickstart", "04_tool_load_camera", "08_your_own_urdf")

pytestmark = [
    pytest.mark.slow,
    pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem),
]


@pytest.mark.slow
def test_notebook_runs(path):
    import nbformat
    from nbclient import NotebookClient

    notebook = nbformat.read(path, as_version=4)
    folder = {"metadata": {"path": str(path.parent)}}
    NotebookClient(notebook, timeout=300, resources=folder).execute()
    outputs = [o for cell in notebook.cells for o in cell.get("outputs", [])]
    assert not [o.text for o in outputs if o.get("name") == "stderr"]  # no warnings either
    printed = "".join(o.text for o in outputs if o.get("name") == "stdout")
    assert [text for text in PRINTED[path.stem] if text not in printed] == []
    drawn = [cell.id for cell in notebook.cells if shown(cell, "image/png")]
    assert drawn == [cell.id for cell in notebook.cells if draws(cell)] != []
    pages = [page for cell in notebook.cells for page in shown(cell, "text/html")]
    assert any("<iframe" in page for page in pages) == (path.stem in ANIMATED)


def shown(cell, kind):
    """Return what of a kind a cell left."""
    data = [o.get("data", {}) for o in cell.get("outputs", [])]
    return [each[kind] for each in data if kind in each]


def draws(cell):
    """Return whether a cell is written to leave a picture."""
    written = re.search(r"^figure, |^(ax = )?draw\(|^rollout\.plot\(\)$", cell.source, re.M)
    return cell.cell_type == "code" and written


def test_notebook_is_stripped(path):
    """Should this fail, ``make strip`` helps."""
    import nbformat

    text = path.read_text(encoding="utf-8")
    notebook = nbformat.reads(text, as_version=4)
    assert text == nbformat.writes(notebook) + "\n"
    assert notebook.metadata == KERNEL
    for cell in notebook.cells:
        assert cell.metadata == {}
        assert re.fullmatch(r"[a-z]+(-[a-z]+)*", cell.id), cell.id  # a name, so that it stays
        if cell.cell_type == "code":
            assert cell.outputs == [] and cell.execution_count is None


def test_notebook_has_one_title_and_says_what_to_change(path):
    import nbformat

    cells = nbformat.read(path, as_version=4).cells
    text = [cell.source for cell in cells if cell.cell_type == "markdown"]
    assert [source for source in text if re.search(r"^# ", source, re.M)] == [cells[0].source]
    assert sum("## Change this and see" in source for source in text) == 1
