"""Arrays that kernels borrow: the layout is checked, temporaries live, and nothing else depends."""

import ctypes
import os
import subprocess
import sys
import weakref
from textwrap import dedent

import numpy as np
import pytest

from pinadapt import _borrowed, _compiled
from pinadapt._kernels import adaptation

pytestmark = pytest.mark.slow

_compiled.compile_all()


def test_the_layout_holds_here():
    assert _borrowed.layout_holds()
    for dispatcher in _compiled.kernels.values():
        (arguments,) = dispatcher.signatures
        arrays = [kind for kind in arguments if isinstance(kind, _borrowed.types.Array)]
        assert arrays and all(isinstance(kind, _borrowed.Borrowed) for kind in arrays)


def swapped(structure, one, other):
    """Return a structure like another one with two fields in each other's place."""
    fields = list(structure._fields_)
    names = [name for name, _ in fields]
    i, j = names.index(one), names.index(other)
    fields[i], fields[j] = fields[j], fields[i]
    return type("Swapped", (ctypes.Structure,), {"_fields_": tuple(fields)})


@pytest.mark.parametrize(
    ("structure", "one", "other"),
    [
        ("_Array", "shape", "strides"),
        ("_Array", "data", "type"),
        ("_Dtype", "order", "kind"),
    ],
)
def test_another_layout_is_noticed(structure, one, other, monkeypatch):
    was = getattr(_borrowed, structure)
    monkeypatch.setattr(_borrowed, structure, swapped(was, one, other))
    assert not _borrowed.layout_holds()


def test_other_machines_are_noticed(monkeypatch):
    monkeypatch.setattr(_borrowed, "_WORD_SIZE", 4)
    assert not _borrowed.layout_holds()


def test_temporaries_live_until_the_kernel_returns():
    """So large that what is freed is given back to the system: reading it would be a crash."""
    n, alive = 1 << 21, []

    def temporary(value):
        array = np.full(n, value).view(type("Own", (np.ndarray,), {}))
        alive.append(weakref.ref(array))
        return array

    for _ in range(3):
        after = np.full(n, np.nan)
        adaptation.exponentiate(temporary(2.0), temporary(1.0), temporary(-1.0), 1e-9, 9.0, after)
        assert np.allclose(after, 2.0 * np.exp(1e-9), rtol=1e-15)
        assert all(reference() is None for reference in alive)


STEPS = """
    import sys
    import numpy as np
    import pinadapt as pa
    from pinadapt import _borrowed, _compiled

    if {broken}:
        _borrowed.layout_holds = lambda: False
    torques = []
    for name, law in (("panda", "separation"), ("ur5", "adaptive-inverse-dynamics")):
        robot = pa.load(name)
        controller = pa.make_controller(robot.changed(inertial_scale=0.8), law=law)
        path = pa.Circle(np.zeros(3), 0.1, 3.0).starting_at(robot.position(robot.q0))
        stream = pa.run(pa.PinocchioPlant(robot), controller, path)
        torques.append([next(stream).torque for _ in range(50)])
    kinds = {{type(kind).__name__ for each in _compiled.kernels.values()
              for kind in each.signatures[0] if hasattr(kind, "ndim")}}
    assert kinds == {{"Array" if {broken} else "Borrowed"}}, kinds
    np.savez(sys.argv[1], *torques)
"""


def test_without_borrowing_torques_are_the_same(tmp_path):
    found = []
    for broken in (False, True):
        path = tmp_path / f"{broken}.npz"
        done = subprocess.run(
            [sys.executable, "-W", "ignore", "-c", dedent(STEPS).format(broken=broken), path],
            env=os.environ,
            capture_output=True,
            text=True,
            timeout=400,
        )
        assert done.returncode == 0, done.stderr
        found.append([np.load(path)[name] for name in np.load(path).files])
    for borrowed, held in zip(*found, strict=True):
        assert np.abs(borrowed).max() > 1.0 and np.allclose(borrowed, held, rtol=1e-12, atol=1e-12)
