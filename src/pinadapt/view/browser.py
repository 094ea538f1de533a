"""The user's browser."""

from __future__ import annotations

import os
import sys
import webbrowser


def open_in_browser(address: str) -> bool:
    """Open an address where there is a display; return whether that was asked of a browser."""
    return _has_display() and webbrowser.open(address)


def _has_display() -> bool:
    """Return whether a browser would have a window; without one it would take the terminal."""
    if sys.platform.startswith("linux"):
        return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
    return True
