"""What to cite for a controller."""

from __future__ import annotations

from ._checks import instance
from .bibliography import PINADAPT, PINOCCHIO
from .controller.controller import Controller


def citation(controller: Controller) -> str:
    """Return the BibTeX entries of what a controller uses, each once.

    In this order: the sources of its law, of both adaptations with what is wrapped around them, of
    Pinocchio, and of this library. A law or an adaptation of your own names its sources as
    ``sources``, a tuple of ``Reference``.

    Raises:
        InputError: what is given is no controller.
    """
    instance(controller, Controller, "citation")
    adaptations = controller.adaptation_d.references() + controller.adaptation_k.references()
    used = (*controller.law.sources, *adaptations, PINOCCHIO, PINADAPT)
    return "\n".join(entry.bibtex() for entry in {entry.key: entry for entry in used}.values())
