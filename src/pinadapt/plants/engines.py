"""What simulates a robot, by name."""

from __future__ import annotations

from functools import partial

from ..exceptions import InputError, did_you_mean
from .mjcf import Mjcf
from .mujoco_plant import MujocoPlant
from .pinocchio_plant import PinocchioPlant
from .simulated_plant import Engine

ENGINES: dict[str, Engine] = {"pinocchio": PinocchioPlant, "mujoco": MujocoPlant}


def engine_of(engine: str | Mjcf | Engine) -> Engine:
    """Return what makes plants: a named engine's, MuJoCo's for a model file, or one as it is.

    Raises:
        InputError: no engine has that name, or it is none of these.
    """
    if isinstance(engine, Mjcf):
        return partial(MujocoPlant, mjcf=engine)
    if callable(engine):
        return engine
    if not isinstance(engine, str) or engine not in ENGINES:
        raise InputError(
            f"must be one of {list(ENGINES)}, a Mjcf, or what makes a plant, got {engine!r}."
            f"{did_you_mean(str(engine), ENGINES)}",
            where="engine",
        )
    return ENGINES[engine]
