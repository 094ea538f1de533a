"""Archives of numpy: arrays by name, each signal a column a joint."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np

from ..exceptions import LogError
from .columns import Wanted, log_of_columns
from .log import Log


def accepts(path: Path) -> bool:
    """Tell whether a path looks like such a file."""
    return path.is_file() and path.suffix.lower() == ".npz"


def read(path: Path, wanted: Wanted) -> Log:
    """Return the log in an archive: t (N), q (N, n), tau (N, n), also v, x, x_time, joint_names.

    Raises:
        LogError: it cannot be read, or lacks a signal.
    """
    return log_of_columns(arrays(path), wanted, str(path))


def arrays(path: Path) -> dict[str, np.ndarray]:
    """Return the arrays of an archive by name.

    Raises:
        LogError: it cannot be read.
    """
    try:
        with np.load(path, allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}
    except (OSError, ValueError, zipfile.BadZipFile) as error:
        raise LogError(f"cannot be read: {error}.", where=str(path)) from error
