"""The pages of the API, one a room of the package, written from its public names."""

import inspect
import re
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
    listed = "\n".join(f"   {room}" for room in rooms)
    parts = [INTRODUCTION, *map(entry, rooms.items()), f".. toctree::\n   :hidden:\n\n{listed}"]
    write(folder / "index.rst", "\n\n".join(parts) + "\n")


INTRODUCTION = """API
===

All names below are used as ``pinadapt.NAME``; they are grouped by the room of the package that they
live in, see :doc:`/architecture`. Most programs need :func:`~pinadapt.load`,
:func:`~pinadapt.make_controller` and :func:`~pinadapt.simulate`, or the ``init`` and ``step`` of
:class:`~pinadapt.Controller`.
"""


def public_names():
    """Return the public names by room, rooms in the order of the package's own list."""
    rooms, listed = defaultdict(list), Path(pinadapt.__file__).with_suffix(".pyi").read_text()
    for room, name in re.findall(r"^from \.(\w+) import (\w+)", listed, re.MULTILINE):
        if not name.startswith("_"):
            made = getattr(getattr(pinadapt, name), "__module__", None)  # plain data has none
            rooms[made.split(".")[1] if made else room].append(name)
    return rooms


def about(room):
    """Return what a room says of itself."""
    return inspect.getdoc(modules[f"pinadapt.{room}"])


def entry(room):
    """Return what the front page tells of a room and its names."""
    name, names = room
    first = " ".join(about(name).split("\n\n")[0].split())
    return f":doc:`{name}`\n   {first}\n\n   {', '.join(map(link, names))}"


def link(name):
    """Return a link to a public name."""
    thing = getattr(pinadapt, name)
    kind = "class" if inspect.isclass(thing) else "func" if callable(thing) else "data"
    return f":py:{kind}:`~pinadapt.{name}`"


def page(room, names):
    """Return the page of a room."""
    parts = [f"{room}\n{'=' * len(room)}", about(room)]
    for name in names:
        thing = getattr(pinadapt, name)
        if inspect.isclass(thing):
            ours = [base for base in thing.__bases__ if "pinadapt" in base.__module__]
            options = "   :members:" + ("\n   :show-inheritance:" if ours else "")
            parts.append(f".. autoclass:: pinadapt.{name}\n{options}")
        elif callable(thing):
            parts.append(f".. autofunction:: pinadapt.{name}")
        else:
            parts.append(f".. py:data:: pinadapt.{name}\n\n{by_name(thing)}")
    return "\n\n".join(parts) + "\n"


def by_name(classes):
    """Return the description of a dictionary of classes."""
    return "\n".join(
        f"   * ``{name}``: :class:`~pinadapt.{thing.__name__}`" for name, thing in classes.items()
    )


def write(path, text):
    """Write a file unless it says so already."""
    if not path.exists() or path.read_text() != text:
        path.write_text(text)
