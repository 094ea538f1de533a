"""The pages of the API: one for the package itself, and one for each package of classes below."""

import inspect
from importlib import import_module
from pathlib import Path
from types import ModuleType

from docstrings import escaped

import pinadapt


def setup(app):
    """Register the hook."""
    app.connect("builder-inited", write_pages)
    return {"parallel_read_safe": True}


def write_pages(app):
    """Write api/PACKAGE.rst for every package; none is touched that is as it was."""
    folder = Path(app.srcdir) / "api"
    folder.mkdir(exist_ok=True)
    found = packages()
    for old in set(folder.glob("*.rst")) - {folder / f"{short(name)}.rst" for name in found}:
        old.unlink()
    for name, names in found.items():
        write(folder / f"{short(name)}.rst", page(name, names))
    listed = "\n".join(f"   {short(name)}" for name in found)
    parts = [INTRODUCTION, *map(entry, found), f".. toctree::\n   :hidden:\n\n{listed}"]
    write(folder / "index.rst", "\n\n".join(parts) + "\n")


INTRODUCTION = """API
===

Most programs need :func:`~pinadapt.load`, :func:`~pinadapt.make_controller` and
:func:`~pinadapt.simulate`, or the ``init`` and ``step`` of :class:`~pinadapt.Controller`. Families
of classes, such as the control laws, have a package each.
"""


DATA = {
    "DEFAULT": "The name of the default law.",
    "LAWS": "The laws by name.",
    "TASKS": "The tasks by name.",
    "TrajectoryLike": "A motion as ``simulate`` takes it: a ``Trajectory``, an object with a "
    "method ``at(t)``, a function of time, or a pair of arrays, times and coordinates.",
}


def packages():
    """Return the public names of the package and of each package below, by its full name."""
    top = [name for name in dir(pinadapt) if not name.startswith("_")]
    below = [name for name in top if isinstance(getattr(pinadapt, name), ModuleType)]
    found = {"pinadapt": [name for name in top if name not in below]}
    below.append("realtime")  # no name of the package itself, which has enough
    below_it = {name: import_module(f"pinadapt.{name}") for name in sorted(below)}
    return found | {f"pinadapt.{name}": public(each) for name, each in below_it.items()}


def short(full):
    """Return the last part of a full name."""
    return full.rpartition(".")[2]


def public(package):
    """Return the public names of a package: what its ``__init__`` imports, without modules.

    Of a package of one file: what it defines.
    """
    if hasattr(package, "__all__"):  # imported at first use
        return sorted(package.__all__)
    things = {name: thing for name, thing in vars(package).items() if not name.startswith("_")}
    if not hasattr(package, "__path__"):
        own = package.__name__
        return [name for name, thing in things.items() if getattr(thing, "__module__", "") == own]
    return [name for name, thing in things.items() if not isinstance(thing, ModuleType)]


def resolved(full):
    """Return the thing of a full name."""
    package, _, name = full.rpartition(".")
    return pinadapt if not package else getattr(resolved(package), name)


def is_data(thing):
    """Return whether an object is plain data or the name of a type, without its own docstring."""
    return not (inspect.isclass(thing) or inspect.isroutine(thing) or isinstance(thing, ModuleType))


def summary(full):
    """Return the first line of a thing's docstring; for plain data the line of ``DATA``."""
    thing = resolved(full)
    said = DATA[short(full)] if is_data(thing) else inspect.getdoc(thing)
    return escaped(said.split("\n\n")[0].replace("\n", " "))


def home(full):
    """Return the full name under which a thing is described: the shortest."""
    name = short(full)
    top = getattr(pinadapt, name, None) if name in dir(pinadapt) else None
    return f"pinadapt.{name}" if top is resolved(full) else full


def table(package, names):
    """Return a table of names, each with one line."""
    full = [f"{package}.{name}" for name in names]
    rows = [f"   * - {link(name)}\n     - {summary(name)}" for name in full]
    return ".. list-table::\n   :widths: 30 70\n\n" + "\n".join(rows)


def entry(package):
    """Return the entry of a package on the front page."""
    return f":doc:`{package} <{short(package)}>`\n   {summary(package)}"


def link(full):
    """Return a link to a public name."""
    thing = resolved(full)
    kind = "class" if inspect.isclass(thing) else "data" if is_data(thing) else "func"
    return f":py:{kind}:`~{home(full)}`"


def page(package, names):
    """Return the page of a package: what it is, a table of its names, then each in full."""
    about = inspect.getdoc(resolved(package))
    parts = [f"{package}\n{'=' * len(package)}", about, table(package, names)]
    for name in names:
        full = f"{package}.{name}"
        thing = resolved(full)
        if home(full) != full:
            continue
        if inspect.isclass(thing):
            ours = [base for base in thing.__bases__ if "pinadapt" in base.__module__]
            options = "   :members:" + ("\n   :show-inheritance:" if ours else "")
            parts.append(f".. autoclass:: {full}\n{options}")
        elif not is_data(thing):
            parts.append(f".. autofunction:: {full}")
        else:
            parts.append(f".. py:data:: {full}\n\n   {summary(full)}\n\n{by_name(package, thing)}")
    return "\n\n".join(parts) + "\n"


def by_name(package, thing):
    """Return the description of plain data: of a dictionary each of its values."""
    if isinstance(thing, str):
        return f"   ``{thing}``"
    if not isinstance(thing, dict):
        return ""
    classes = {name: each if inspect.isclass(each) else type(each) for name, each in thing.items()}
    return "\n".join(
        f"   * ``{name}``: :class:`~{package}.{each.__name__}`" for name, each in classes.items()
    )


def write(path, text):
    """Write a file unless it says so already."""
    if not path.exists() or path.read_text() != text:
        path.write_text(text)
