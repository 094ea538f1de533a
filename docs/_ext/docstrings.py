"""From this library's docstrings to reStructuredText.

A law's docstring is a table of plain text, ``Law:   tau = ...`` with lines hanging below; formulas
in plain text hold ``|x|`` and names that end in an underscore. Here the table becomes a list of
fields, and what reStructuredText would read as markup is escaped.
"""

import re

_ENTRY = re.compile(r"^([A-Z][A-Za-z ]*):\s{2,}(\S.*)$")
_LITERAL = re.compile(r"(``.*?``)")
_MARKUP = re.compile(r"\||(?<=\w)_(?!\w)|(?<![*\w])\*(?=\w+[^*]*$)")


def setup(app):
    """Register the hooks, ahead of napoleon's."""
    app.connect("autodoc-process-docstring", to_rst, priority=400)
    app.connect("autodoc-skip-member", skip)
    return {"parallel_read_safe": True}


def to_rst(app, what, name, obj, options, lines):
    """Rewrite a docstring in place."""
    written = []
    for line in lines:
        entry = _ENTRY.match(line)
        if entry and written and written[-1] and not written[-1].startswith((":", " ")):
            written.append("")
        line = f":{entry[1]}: {entry[2]}" if entry else line
        written.append(escaped(line))
    lines[:] = written


def escaped(line):
    """Return a line in which reStructuredText finds no markup but literals."""
    parts = _LITERAL.split(line)
    return "".join(
        part if part.startswith("``") else _MARKUP.sub(lambda found: "\\" + found[0], part)
        for part in parts
    )


def skip(app, what, name, obj, skipped, options):
    """Leave out the fields of named tuples, which the class describes, and methods' twins."""
    left_out = type(obj).__name__ == "_tuplegetter"
    return True if left_out else None
