"""A published source, as a record that writes itself in BibTeX."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

_ACRONYM = re.compile(r"(?<!\{)\b[A-Z][A-Za-z]*[A-Z+]\S*")


@dataclass(frozen=True, eq=False)
class Reference:
    """A source of a law, an adaptation or a tool.

    Attributes:
        key: by which LaTeX cites it.
        fields: BibTeX's fields by name, in the order in which they are written.
        kind: BibTeX's type of the entry.
    """

    key: str
    fields: Mapping[str, str]
    kind: str = "article"

    def bibtex(self) -> str:
        """Return the entry as BibTeX; capitals of acronyms in the title are kept."""
        fields = dict(self.fields)
        fields["title"] = _ACRONYM.sub(lambda found: f"{{{found[0]}}}", fields["title"])
        width = max(map(len, fields))
        lines = [f"  {name:<{width}} = {{{value}}},\n" for name, value in fields.items()]
        return f"@{self.kind}{{{self.key},\n{''.join(lines)}}}\n"
