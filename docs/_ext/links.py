"""Links to the READMEs of robots, from docs/ or from one another, lead to their pages on the site.

In the repository the links are relative, so that they work there too.
"""

import re

_ROBOT = re.compile(r"\[([^\]]+)\]\(\.\./(?:robots/)?(\w+/README)\.md\)")


def setup(app):
    """Register the hook."""
    app.connect("source-read", stay_inside)
    return {"parallel_read_safe": True}


def stay_inside(app, docname, source):
    """Turn links to a robot's README into links to its page."""
    source[0] = _ROBOT.sub(r"{doc}`\1 </robots/\2>`", source[0])
