"""Stand-ins of ROS."""

import sys
from types import ModuleType, SimpleNamespace


def put_in_place(monkeypatch, modules):
    """Make modules importable, each given by its contents."""
    for name, things in modules.items():
        made = ModuleType(name)
        vars(made).update(things)
        monkeypatch.setitem(sys.modules, name, made)


def joint_state(m, names, effort):
    """Return a measurement as a message, with the joints in the opposite order."""
    stamp = SimpleNamespace(sec=int(m.t), nanosec=round(1e9 * (m.t % 1.0)))
    return SimpleNamespace(
        header=SimpleNamespace(stamp=stamp),
        name=names[::-1],
        position=m.q[::-1],
        velocity=m.v[::-1],
        effort=effort[::-1],
    )
