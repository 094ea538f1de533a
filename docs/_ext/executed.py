"""Notebooks are shown with the outputs of the tests, so that each is run only once.

`tests/docs/test_notebooks.py` writes them to build/notebooks. A notebook without outputs there, or
with outputs older than the notebook or the library, is run while the site is built.
"""

from pathlib import Path

ROOT = Path(__file__).parents[2]


def setup(app):
    """Register the hooks."""
    app.connect("config-inited", leave_out, priority=100)  # before myst-nb reads its settings
    app.connect("source-read", take_outputs)
    return {"parallel_read_safe": True}


def executed():
    """Return the executed notebooks by the name of their page."""
    library = max(path.stat().st_mtime for path in (ROOT / "src").rglob("*.py"))
    found = {}
    for path in (ROOT / "notebooks").glob("*.ipynb"):
        ran = ROOT / "build" / "notebooks" / path.name
        if ran.is_file() and ran.stat().st_mtime > max(library, path.stat().st_mtime):
            found[f"notebooks/{path.stem}"] = ran
    return found


def leave_out(app, config):
    """Exclude executed notebooks from execution."""
    config.nb_execution_excludepatterns = [f"{page}.ipynb" for page in executed()]


def take_outputs(app, docname, source):
    """Replace a notebook without outputs by the executed one."""
    if docname in (found := executed()):
        source[0] = found[docname].read_text(encoding="utf-8")
