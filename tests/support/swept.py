"""Functions that sweeps of the tests run; workers import them by name."""

import os
import time
from pathlib import Path


def doubled(a=0.0, b=0.0, seed=0):
    """Return numbers of the values and of the seed."""
    return {"twice": 2.0 * (a + b), "random": seed % 97, "word": f"w{int(a)}"}


def troubled(a):
    """Raise, hang, or end the process, at some values."""
    if a == 1:
        raise ValueError("one")
    if a == 2:
        os._exit(9)
    if a == 3:
        time.sleep(100.0)
    return {"square": a * a}


def fewer_troubles(a):
    """Return what ``troubled`` would, without its failures."""
    return {"square": a * a}


def slow(a, place):
    """Leave a mark of having run, and take a moment."""
    with (Path(place) / f"{a}").open("a") as file:
        file.write("x")
    time.sleep(0.02)
    return a


def valley(place, gain=1.0):
    """Return how far a gain is from a place, and a tenth."""
    return {"distance": 0.1 + abs(gain - place)}
