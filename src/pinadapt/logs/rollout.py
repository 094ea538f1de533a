"""What ``pinadapt run`` writes: a folder of a run, or its ``rollout.npz``."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from ..exceptions import LogError
from .columns import Wanted
from .log import Log
from .npz import arrays

ARRAYS, SUMMARY = "rollout.npz", "summary.json"
_OURS = {"t", "q", "v", "tau", "x", "x_d", "saturated"}


def accepts(path: Path) -> bool:
    """Tell whether a path is the folder of a run, or its arrays."""
    if path.is_dir():
        return (path / ARRAYS).is_file()
    try:
        with zipfile.ZipFile(path) as archive:
            return {name.removesuffix(".npy") for name in archive.namelist()} >= _OURS
    except (OSError, zipfile.BadZipFile):
        return False


def read(path: Path, wanted: Wanted) -> Log:
    """Return the log of a run, from the last change of its robot on.

    Its torques are those that the controller held from each sample to the next, and x is the true
    position of the task frame. A joint task's x is q, which is left out.

    Raises:
        LogError: it cannot be read, or nothing ran.
    """
    file = path / ARRAYS if path.is_dir() else path
    found, about = arrays(file), _summary(file.with_name(SUMMARY))
    if not len(found["t"]):
        raise LogError("nothing ran, so nothing was recorded.", where=str(file))
    log = Log(
        found["t"],
        found["q"],
        found["tau"],
        found["v"],
        tuple(about.get("joint_names", ())) if found["q"].shape == found["v"].shape else (),
        None if about.get("task") == "joint" else found["x"],
        held=True,
        source=str(path),
    )
    changes = [change["at"] for change in about.get("changes", ()) if change["what"] != "told"]
    since = max((at for at in changes if at <= log.t[-1]), default=-np.inf)
    return log.after(since)


def _summary(file: Path) -> dict[str, Any]:
    """Return what is known of a run besides its arrays."""
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}
