"""The notebooks run from top to bottom and print what their text states; outputs are stripped."""

import re

import pytest

from tests.support.paths import ROOT

NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
EXECUTED = ROOT / "build" / "notebooks"

# nbformat is imported where it is used: importing it takes seconds in every test process.

# Printed results on which the text relies; the cells themselves assert more.
PRINTED = {
    "01_quickstart": ["same as the simulation: True", "the last body: 2.3"],
    "02_the_paper": ["ended at 34 ms", "no longer positive definite", "largest difference"],
    "03_regressors": ["rank 43 of 70", "translations: 14 of 21"],
    "04_tool_load_camera": ["delay ignored: 15"],
    "05_unknown_lengths": ["60 parameters", "56 parameters", "no V"],
    "06_physical_consistency": ["gradient (18): det M_hat", "no longer positive definite"],
    "07_laws_compared": ["times closer by adaptation"],
    "08_your_own_urdf": ["follows: ", "all limits kept", 'law = "separation"', "'flange'?"],
    "09_your_own_law": ["deg at the end", "largest rise in a sample -"],
    "12_a_thousand_runs": ["0 lost", "the same bits: True", "nothing ran again"],
    "13_without_calibration": ["1.257", "the same rotation: True", "within a pixel: True"],
    "10_from_a_log": ["--torque-gain=13", "times less", "are swapped"],
    "11_behind_a_protocol": [
        "log: the time is over, running -> stopped",
        "adapt: the time is over, running -> holding -> damping -> stopped",
        "adaptation reduces the error: True",
        "the same torques, bit for bit: True",
        "True | does not answer",
    ],
}
NEEDS = {"11_behind_a_protocol": "pylibfranka"}  # of which there are no wheels everywhere
ANIMATED = (
    "01_quickstart",
    "04_tool_load_camera",
    "08_your_own_urdf",
    "13_without_calibration",
)

# Clears the names of a notebook, so that the next one starts as in a kernel of its own. Runs keep
# a million small objects; searching them for garbage as often as by default takes a tenth of all.
CLEARED = """
import gc
gc.set_threshold(100_000, 50, 100)
for _name in set(globals()) - set(get_ipython().user_ns_hidden):
    del globals()[_name]
"""

by_name = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)


@pytest.fixture(scope="module")
def run():
    """Return a function that runs a notebook, all of them in one kernel: it starts only once."""
    from jupyter_client import AsyncKernelManager
    from nbclient import NotebookClient
    from nbclient.util import run_sync
    from nbformat import v4

    kernel = AsyncKernelManager(kernel_name="python3")

    def executed(notebook):
        clear = v4.new_notebook(cells=[v4.new_code_cell(CLEARED)])
        for each in (clear, notebook):
            where = {"metadata": {"path": str(NOTEBOOKS[0].parent)}}
            NotebookClient(each, km=kernel, timeout=300, resources=where).execute()

    yield executed
    run_sync(kernel.shutdown_kernel)(now=True)


@pytest.mark.notebooks
@by_name
def test_notebook_runs_and_prints_what_its_text_states(path, run):
    """The outputs are written to build/notebooks and shown on the site; see docs/_ext/executed."""
    import nbformat

    if path.stem in NEEDS:
        pytest.importorskip(NEEDS[path.stem], reason="the extra franka is not installed")
    for _ in range(2):  # a loop on a clock may be late once, on a busy machine
        notebook = nbformat.read(path, as_version=4)
        run(notebook)
        outputs = [o for cell in notebook.cells for o in cell.get("outputs", [])]
        assert not [o.text for o in outputs if o.get("name") == "stderr"]  # no warnings either
        printed = "".join(o.text for o in outputs if o.get("name") == "stdout")
        if "late: " not in printed:
            break
    assert [text for text in PRINTED[path.stem] if text not in printed] == [], printed
    drawn = [cell.id for cell in notebook.cells if shown(cell, "image/png")]
    assert drawn == [cell.id for cell in notebook.cells if draws(cell)] != []
    pages = [page for cell in notebook.cells for page in shown(cell, "text/html")]
    assert any("<iframe" in page for page in pages) == (path.stem in ANIMATED)
    EXECUTED.mkdir(parents=True, exist_ok=True)
    nbformat.write(notebook, EXECUTED / path.name)


def shown(cell, kind):
    """Return the outputs of one kind of a cell."""
    data = [o.get("data", {}) for o in cell.get("outputs", [])]
    return [each[kind] for each in data if kind in each]


def draws(cell):
    """Return whether the source of a cell draws a figure."""
    calls = r"^figure, |^(ax = )?draw\(|^rollout\.plot\(\)$|^report\.(tornado|bands|map)\("
    written = re.search(calls, cell.source, re.M)
    return cell.cell_type == "code" and written
