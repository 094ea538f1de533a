"""Reading TOML, and writing files completely or not at all."""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

from .exceptions import InputError, ScenarioError

if sys.version_info >= (3, 11):
    import tomllib as toml
else:
    import tomli as toml

UNFINISHED = ".unfinished-"  # prefix of files and folders that are being written
_ABANDONED = 3600.0  # [s]; an older one was left by a process that was killed
_PROBE = bytes(4096)  # written as a test


def read_toml(path: Path) -> dict[str, Any]:
    """Return the contents of a TOML file.

    Raises:
        ScenarioError: there is no such file, or it is not TOML; the message has line and column.
    """
    if not path.is_file():
        raise ScenarioError("no such file.", where=str(path))
    try:
        return toml.loads(
            path.read_text(encoding="utf-8-sig")
        )  # some editors write a byte order mark
    except UnicodeDecodeError as error:
        raise ScenarioError(
            f"not valid TOML: {error}", where=str(path), hint="Save the file as UTF-8."
        ) from error
    except ValueError as error:  # a TOML error, or an integer with too many digits
        raise ScenarioError(f"not valid TOML: {error}", where=str(path)) from error
    except RecursionError as error:
        raise ScenarioError("not valid TOML: nested too deeply.", where=str(path)) from error


@contextmanager
def whole_file(path: Path) -> Iterator[BinaryIO]:
    """Open a temporary file beside ``path`` and rename it to ``path`` once it is complete.

    Missing folders are created. If writing fails, the temporary file is removed and an existing
    file at ``path`` stays unchanged.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_name(f"{UNFINISHED}{os.getpid()}-{path.name}")
    try:
        with beside.open("wb") as file:
            yield file
        beside.replace(path)
    except BaseException:
        beside.unlink(missing_ok=True)
        raise


def write_text(path: Path, text: str) -> None:
    """Write a file in UTF-8, completely or not at all; lone surrogates become question marks."""
    with whole_file(path) as file:
        file.write(text.encode("utf-8", errors="replace"))


@contextmanager
def one_run(folder: Path, names: Sequence[str]) -> Iterator[Path]:
    """Yield a temporary folder whose files finally replace the files ``names`` of ``folder``.

    All old files are removed before the first new one is moved in, so files of two runs are never
    mixed, even if the process is killed. The last name is removed first and moved last: if it
    exists, all of them do. Complete files are moved even if writing fails later; if there is none,
    the old files stay.
    """
    folder.mkdir(parents=True, exist_ok=True)
    beside = Path(tempfile.mkdtemp(prefix=UNFINISHED, dir=folder))
    try:
        yield beside
    finally:
        whole = [name for name in names if (beside / name).is_file()]
        for name in reversed(names) if whole else ():
            (folder / name).unlink(missing_ok=True)
        for name in whole:
            (beside / name).replace(folder / name)
        shutil.rmtree(beside, ignore_errors=True)
        _tidy(folder)


def check_writable(folder: Path, names: Sequence[str] = ()) -> None:
    """Check that files can be written into a folder, which need not exist.

    Raises:
        InputError: they cannot be written, or one of ``names`` is a folder.
    """
    missing = not folder.is_dir()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as probe:
            probe.write(_PROBE)
        taken = [name for name in names if (folder / name).is_dir()]
        if missing:
            folder.rmdir()
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(
            f"cannot be written: {reason}.",
            where=str(folder),
            hint="Choose another folder by --out.",
        ) from error
    if taken:
        raise InputError(
            "is a folder, but a file of this name has to be written.", where=str(folder / taken[0])
        )


def _tidy(folder: Path) -> None:
    """Remove what killed processes left in a folder."""
    for left in folder.glob(f"{UNFINISHED}*"):
        with suppress(OSError):
            if time.time() - left.stat().st_mtime > _ABANDONED:
                shutil.rmtree(left) if left.is_dir() else left.unlink()
