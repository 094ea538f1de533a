"""TOML files, on every supported Python."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

if sys.version_info >= (3, 11):
    import tomllib as toml
else:
    import tomli as toml

from .exceptions import ScenarioError


def read_toml(path: Path) -> dict[str, Any]:
    """Return the table in a TOML file.

    Raises:
        ScenarioError: no such file, or not TOML; line and column are told.
    """
    if not path.is_file():
        raise ScenarioError("no such file.", where=str(path))
    try:
        return toml.loads(path.read_text(encoding="utf-8-sig"))  # editors may put a mark before it
    except UnicodeDecodeError as error:
        raise ScenarioError(
            f"not valid TOML: {error}", where=str(path), hint="Save the file as UTF-8."
        ) from error
    except ValueError as error:  # TOML's own, and of an integer with too many digits
        raise ScenarioError(f"not valid TOML: {error}", where=str(path)) from error
    except RecursionError as error:
        raise ScenarioError("not valid TOML: nested too deeply.", where=str(path)) from error


def parse_toml_value(text: str) -> Any:
    """Return the value of one TOML expression; bare words that are no TOML are taken as strings."""
    try:
        return toml.loads(f"value = {text}")["value"]
    except toml.TOMLDecodeError:
        return text
    except (ValueError, RecursionError) as error:
        raise ScenarioError("a value too long or nested too deeply.", where="--set") from error
