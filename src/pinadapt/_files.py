"""Files that are whole or not there at all, and folders that hold those of one run only."""

from __future__ import annotations

import os
import shutil
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from .exceptions import InputError

UNFINISHED = ".unfinished-"  # begins the name of a folder in which outputs are being written
_FORGOTTEN = 3600.0  # [s] after which such a folder is that of a process that was killed
_PROBE = bytes(4096)


@contextmanager
def whole_file(path: Path) -> Iterator[BinaryIO]:
    """Open a file beside ``path``, in a folder made if missing; it is moved there once it is whole.

    Where the writing fails nothing is left of it, and what stood at ``path`` stays.
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
    """Write a whole file in UTF-8; half surrogates, which UTF-8 has not, become question marks."""
    with whole_file(path) as file:
        file.write(text.encode("utf-8", errors="replace"))


@contextmanager
def one_run(folder: Path, names: Sequence[str]) -> Iterator[Path]:
    """Yield a new folder inside of ``folder``; what it holds then takes the place of ``names``.

    All files of these names in ``folder`` go before the first new one comes, so that those of two
    runs never stand beside each other, even if the process is killed in between. The last name goes
    first and comes last: where it is, all are. What was written whole is moved also where the
    writing fails; where nothing was, the old files stay.
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
    """See whether files can be written into a folder, which may be missing.

    Raises:
        InputError: they cannot, or one of ``names`` is taken by a folder.
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
            f"cannot be written: {reason}.", where=str(folder), hint="--out takes another place."
        ) from error
    if taken:
        raise InputError(
            "is a folder; a file of this name is to be written.", where=str(folder / taken[0])
        )


def _tidy(folder: Path) -> None:
    """Remove what killed processes have left in a folder."""
    for left in folder.glob(f"{UNFINISHED}*"):
        with suppress(OSError):
            if time.time() - left.stat().st_mtime > _FORGOTTEN:
                shutil.rmtree(left) if left.is_dir() else left.unlink()
