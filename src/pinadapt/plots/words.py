"""Words that are shown as they are, whatever signs they hold."""

from __future__ import annotations


def literal(text: str) -> str:
    """Return a text that matplotlib draws as it is.

    It would take what stands between two dollars for mathematics, leave a label that begins with an
    underscore out of the legend, and fail at half surrogates.
    """
    shown = text.encode("utf-8", errors="replace").decode("utf-8").replace("$", r"\$")
    return f" {shown}" if shown.startswith("_") else shown
