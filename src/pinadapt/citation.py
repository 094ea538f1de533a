"""What to cite for a controller, from the BibTeX file ``references.bib``."""

from __future__ import annotations

import re
from functools import cache
from importlib.resources import files
from inspect import cleandoc

from ._checks import instance
from .controller.controller import Controller
from .exceptions import InputError, did_you_mean

SOFTWARE = ("Carpentier2019", "pinadapt")  # keys of Pinocchio and of this library


def citation(controller: Controller) -> str:
    """Return the BibTeX entries of what a controller uses, each once.

    The order is: sources of the law, sources of both adaptations with their wrappers, Pinocchio,
    this library. ``Law.sources`` and ``Adaptation.sources`` are tuples of keys of
    ``references.bib``; a law or an adaptation of your own may also give a whole BibTeX entry
    (``"@article{Me2026, ...}"``).

    Raises:
        InputError: the argument is not a controller, or a source is neither a known key nor a
            BibTeX entry.
    """
    instance(controller, Controller, "citation")
    adaptations = controller.adaptation_d.sources + controller.adaptation_k.sources
    entries: dict[str, str] = {}
    for source in (*controller.law.sources, *adaptations, *SOFTWARE):
        known = references()
        own = {source: known[source]} if source in known else parse_bibtex(cleandoc(source))
        if not own:
            raise InputError(
                f"there is no entry '{source}' in references.bib.{did_you_mean(source, known)}",
                where="sources",
                hint='Give the BibTeX entry itself: sources = ("@article{key, ...}",).',
            )
        entries |= own
    return "\n".join(entries.values())


@cache
def references() -> dict[str, str]:
    """Return all entries of ``references.bib`` by key."""
    return parse_bibtex((files(__package__) / "references.bib").read_text(encoding="utf-8"))


def parse_bibtex(text: str) -> dict[str, str]:
    """Return the entries of a BibTeX text by key, each as it is written and with a newline.

    An entry starts a line with ``@kind{key,`` and ends at the last brace before the next one. As in
    BibTeX, all text between entries is a comment.
    """
    return {
        key: part[: part.rfind("}") + 1].strip() + "\n"
        for part in re.split(r"^(?=[ \t]*@\w+\s*\{)", text, flags=re.MULTILINE)
        for key in re.findall(r"^\s*@\w+\s*\{\s*([^\s,{}]+)\s*,", part)
    }
