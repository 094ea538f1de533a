"""The notebooks run from top to bottom and say what they print; the tree holds no outputs."""

import re
from pathlib import Path

import pytest

NOTEBOOKS = sorted((Path(__file__).parents[1] / "notebooks").glob("*.ipynb"))
KERNEL = {"kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"}}

# nbformat is imported where it is used: it takes seconds, and every process collects this file.

# What the text around the cells relies on.
PRINTED = {
    "01_quickstart": ["same as the simulation: True"],
    "02_the_paper": ["ended at 34 ms", "no longer positive definite", "largest difference"],
}

pytestmark = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)


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
    drawn = [cell.id for cell in notebook.cells if pictures(cell)]
    assert drawn == [cell.id for cell in notebook.cells if draws(cell)]


def pictures(cell):
    """Return the pictures that a cell left."""
    return [o for o in cell.get("outputs", []) if "image/png" in o.get("data", {})]


def draws(cell):
    """Return whether a cell is written to leave a picture."""
    return cell.cell_type == "code" and re.search(r"^figure, |^(ax = )?draw\(", cell.source, re.M)


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


def test_notebook_says_what_to_change(path):
    import nbformat

    notebook = nbformat.read(path, as_version=4)
    assert sum("## Change this and see" in cell.source for cell in notebook.cells) == 1
