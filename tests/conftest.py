"""Fixtures of all tests."""

import gc
import signal

import pytest

# Rewritten tests and recorded runs keep hundreds of thousands of small objects. Searched for
# garbage as often as by default, they take a quarter of the collection, and 5 % of closed loops.
gc.set_threshold(100_000, 50, 100)

# A shell starts what it runs in the background with Ctrl-C ignored; tests send it.
signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_configure(config):
    """Compile all kernels, before every worker compiles them: that takes it some 12 s."""
    if getattr(config.option, "numprocesses", None):
        import pinadapt.tuning.make_controller  # noqa: F401, imports all that has kernels
        from pinadapt._compiled import compile_all

        compile_all()


@pytest.fixture
def blank_pictures(monkeypatch):
    """Leave pictures blank, in tests that do not look at their contents."""
    from pinadapt.plots.figures import Figures
    from pinadapt.plots.style import Picture

    blank = Picture(figsize=(0.1, 0.1))
    png = blank.png()
    figures = Figures(*[blank] * len(Figures._fields))
    monkeypatch.setattr(Figures, "of", lambda run: figures)
    monkeypatch.setattr(Picture, "png", lambda self, dpi=100: png)
    for drawn in ("parameter", "prediction"):  # those of an identification
        monkeypatch.setattr(f"pinadapt.plots.figures.{drawn}_figure", lambda *_, **__: blank)


@pytest.fixture
def unpainted(monkeypatch):
    """Draw figures without rendering them to pixels, in tests of what is drawn."""
    from pinadapt.plots.style import Picture

    monkeypatch.setattr(Picture, "png", lambda self, dpi=100: b"not painted")


@pytest.fixture
def interruptible():
    """Handle Ctrl-C, which processes that a shell starts in the background ignore."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture
def forked():
    """Let the processes of arms and logs be copies of this one, in tests of what they do."""
    from tests.support.arms import forking

    with forking():
        yield


def pytest_collection_finish(session):
    """Exclude imported and collected objects from later garbage collections, for speed."""
    gc.collect()
    gc.freeze()


@pytest.fixture(autouse=True, scope="module")
def left_by_other_modules():
    """Exclude objects of earlier modules too: a real-time loop begins with a collection."""
    gc.freeze()
