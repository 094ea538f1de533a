"""The site: `make docs` builds it into build/site, with warnings as errors."""

import sys
from importlib.util import find_spec
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "docs" / "_ext"))

from pinadapt import __version__  # noqa: E402  after the path

project = "pinadapt"
author = "The pinadapt developers"
project_copyright = "2026, the pinadapt developers"
version = release = __version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.mathjax",
    "sphinx-mathjax-offline",
    "packages",
    "docstrings",
    "links",
    "executed",
]
source_suffix = {".rst": "restructuredtext", ".md": "myst-nb", ".ipynb": "myst-nb"}
exclude_patterns = ["_ext", "robots/README.md"]

html_theme = "furo"
html_title = f"pinadapt {version}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_favicon = "_static/icon.svg"
html_copy_source = False
html_show_sourcelink = False

myst_enable_extensions = ["amsmath", "dollarmath"]
myst_heading_anchors = 3
math_numfig = False

# Notebooks are stored without outputs. Those that the tests have run are shown with these outputs,
# see _ext/executed.py; others are run here, in their folder.
nb_execution_mode = "auto"
nb_execution_excludepatterns = [] if find_spec("pylibfranka") else ["*11_behind_a_protocol*"]
nb_execution_timeout = 600
nb_execution_raise_on_error = True
nb_ipywidgets_js = {}  # no requests to other hosts

autodoc_member_order = "bysource"
toc_object_entries_show_parents = "hide"
autodoc_typehints_format = "short"
python_maximum_signature_line_length = 88
napoleon_numpy_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False
