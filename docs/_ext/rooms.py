"""The pages of the API, one a room of the package, written from its public names."""

import inspect
from collections import defaultdict
from pathlib import Path
from sys import modules

import pinadapt


def setup(app):
    """Register the hook."""
    app.connect("builder-inited", write_pages)
    return {"parallel_read_safe": True}


def write_pages(app):
    """Write api/ROOM.rst for every room; none is touched that is as it was."""
    folder = Path(app.srcdir) / "api"
    folder.mkdir(exist_ok=True)
    rooms = public_names()
    for old in set(folder.glob("*.rst")) - {folder / f"{room}.rst" for room in rooms}:
        old.unlink()
    for room, names in rooms.items():
        write(folder / f"{room}.rst", page(room, names))
    toctree = "".join(f"   {room}\n" for room in rooms)
    write(folder / "index.rst", f"{INTRODUCTION}\n.. toctree::\n   :maxdepth: 1\n\n{toctree}")


INTRODUCTION = """API
===

All names below are used as ``pinadapt.NAME``; they are grouped by the room of the package that they
live in, see :doc:`/architecture`. Most programs need :func:`~pinadapt.load`,
:func:`~pinadapt.make_controller` and :func:`~pinadapt.simulate`, or the ``init`` and ``step`` of
:class:`~pinadapt.Controller`.
"""


def public_names():
    """Return the public names by room, rooms in the order of the package's own list."""
    rooms = defaultdict(list)
    for name, thing in vars(pinadapt).items():
        module = getattr(thing, "__module__", None) or ""
        if not name.startswith("_") and not inspect.ismodule(thing) and "pinadapt" in module:
            rooms[module.split(".")[1]].append(name)
    return rooms


def page(room, names):
    """Return the page of a room."""
    about = inspect.getdoc(modules[f"pinadapt.{room}"])
    parts = [f"{room}\n{'=' * len(room)}", about]
    for name in names:
        thing = getattr(pinadapt, name)
        if inspect.isclass(thing):
            options = "   :members:\n   :show-inheritance:"
            parts.append(f".. autoclass:: pinadapt.{name}\n{options}")
        else:
            parts.append(f".. autofunction:: pinadapt.{name}")
    return "\n\n".join(parts) + "\n"


def write(path, text):
    """Write a file unless it says so already."""
    if not path.exists() or path.read_text() != text:
        path.write_text(text)
