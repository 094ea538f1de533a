"""Errors of the library, told with the scenario's dotted keys."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from ..exceptions import InputError
from .schema import ScenarioTables, allowed_keys


@contextmanager
def prefix_errors(key: str) -> Iterator[None]:
    """Put a section or dotted key in front of an error's place, unless it stands there.

    Raises:
        InputError: of the kind raised inside.
    """
    try:
        yield
    except InputError as error:
        place = error.where or ""
        head = place.partition(".")[0]
        if head in ScenarioTables.model_fields:
            raise
        inside = allowed_keys((*key.split("."), ""), {})
        if head not in inside and head in allowed_keys(("simulation", ""), {}):
            key, inside = "simulation", [head]  # a controller is told of its sensors and limits
        joint = "." if head in inside else ": "
        raise type(error)(
            error.what, where=f"{key}{joint}{place}" if place else key, hint=error.hint
        ) from error
