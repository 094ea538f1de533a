"""Reading and checking scenario files; errors name the dotted key and the nearest allowed one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from .._checks import LARGEST, SMALLEST, shown
from .._files import read_toml, toml
from ..exceptions import InputError, ScenarioError, did_you_mean
from .schema import REFERENCES, ScenarioTables, allowed_keys


@contextmanager
def prefix_errors(key: str) -> Iterator[None]:
    """Prefix the place of errors raised inside with a section or dotted key.

    Raises:
        InputError: the error raised inside, with its own type.
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
            key, inside = (
                "simulation",
                [head],
            )  # sensors and limits of the controller are keys of [simulation]
        joint = "." if head in inside else ": "
        raise type(error)(
            error.what, where=f"{key}{joint}{place}" if place else key, hint=error.hint
        ) from error


def read_tables(path: Path, settings: Sequence[str] = ()) -> ScenarioTables:
    """Return the checked tables of a scenario file after applying ``key=value`` settings.

    Raises:
        ScenarioError: the file is missing or not TOML, or a key or value is not allowed.
    """
    raw = read_toml(path)
    for setting in settings:
        _apply(raw, setting)
    return check_tables(raw, str(path))


def check_tables(raw: Mapping[str, Any], where: str) -> ScenarioTables:
    """Return checked tables from raw ones.

    Raises:
        ScenarioError: a key or value is not allowed; the message says which are and suggests the
            nearest.
    """
    raw = dict(raw)
    if isinstance(raw.get("reference"), dict):
        raw["reference"] = {"kind": "circle", **raw["reference"]}
    try:
        return ScenarioTables.model_validate(raw)
    except ValidationError as error:
        raise ScenarioError(_explain(error, raw), where=where) from error


def _apply(raw: dict[str, Any], setting: str) -> None:
    """Write one dotted ``key=value`` into raw tables."""
    key, equals, text = setting.partition("=")
    parts = key.strip().split(".")
    if not equals or not all(parts):
        raise ScenarioError(
            f"expected key=value with a dotted key, got '{setting}'.", where="--set"
        )
    table = raw
    for part in parts[:-1]:
        table = table.setdefault(part, {})
        if not isinstance(table, dict):
            raise ScenarioError(f"'{part}' in '{key}' is not a table.", where="--set")
    table[parts[-1]] = _value(text.strip())


def _value(text: str) -> Any:
    """Return the value of a TOML expression; text that is not TOML is taken as a string."""
    try:
        return toml.loads(f"value = {text}")["value"]
    except toml.TOMLDecodeError:
        return text
    except (ValueError, RecursionError) as error:
        raise ScenarioError("the value is too long or nested too deeply.", where="--set") from error


def _explain(error: ValidationError, raw: dict[str, Any]) -> str:
    """Return one sentence for each key with a problem."""
    sentences: dict[str, list[str]] = {}
    for problem in error.errors(include_url=False):
        location = tuple(part for part in problem["loc"] if part not in REFERENCES)
        location += ("kind",) if problem["type"] == "union_tag_invalid" else ()
        key = _dotted(location)
        sentences.setdefault(key, []).append(_sentence(problem, location, raw))
    return "; ".join(
        f"{key}: {' or '.join(dict.fromkeys(parts))}" for key, parts in sentences.items()
    )


def _dotted(location: tuple[Any, ...]) -> str:
    """Return a dotted key, without the names that pydantic adds for unions of types."""
    names = [
        str(part)
        for part in location
        if not (isinstance(part, str) and ("[" in part or part in _TYPES))
        and not str(part).endswith("Section")
    ]
    return ".".join(names) or "scenario"


_TYPES = {"float", "constrained-float", "int", "str", "dict", "bool", "list"}


def _message(problem: Any) -> str:
    """Return what is wrong with a value; limits of floating-point range are named as such."""
    bounds = problem.get("ctx", {})
    if LARGEST in (bounds.get("le"), -bounds.get("ge", 0.0)):
        return f"is too large to compute with, over {LARGEST:g}"
    if bounds.get("ge") == SMALLEST:
        positive = problem["input"] > 0.0
        tiny = f"is too small to compute with, under {SMALLEST:g}"
        return tiny if positive else "input should be greater than 0"
    return str(problem["msg"][0].lower() + problem["msg"][1:])


def _sentence(problem: Any, location: tuple[Any, ...], raw: dict[str, Any]) -> str:
    if problem["type"] == "extra_forbidden":
        allowed = allowed_keys(location[:-1], raw)
        guess = did_you_mean(str(location[-1]), allowed)
        return f"unknown key; allowed here: {', '.join(allowed)}.{guess}"
    if problem["type"] == "missing":
        return "this key is required"
    if problem["type"] == "model_type":
        return f"expected a table, got {shown(problem['input'])}"
    message = _message(problem)
    expected = problem.get("ctx", {}).get("expected") or problem.get("ctx", {}).get("expected_tags")
    options = (
        [word.strip(" '") for word in str(expected).replace(" or ", ",").split(",")]
        if expected
        else []
    )
    given = problem.get("ctx", {}).get("tag", problem["input"])
    guess = did_you_mean(given, options) if isinstance(given, str) else ""
    return f"{message}, got {shown(given)}.{guess}"
