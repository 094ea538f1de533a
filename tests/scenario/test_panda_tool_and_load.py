"""Panda learns an unknown tool and load, every inertial parameter adapted, at 1 kHz."""

from dataclasses import replace

import numpy as np
import pytest

from pinadapt.scenario.comparison import comparison_table
from pinadapt.scenario.scenario import Scenario
from tests.support.paths import ROOT

pytestmark = pytest.mark.slow

PANDA = ROOT / "robots" / "panda" / "tool_and_load.toml"


def test_panda_learns_its_tool_and_tracks_ten_times_better_than_unadapted():
    adapted = Scenario.read(PANDA, ["simulation.duration=2.0", "controller.dt=0.002"]).run()
    assert adapted.diverged is None and adapted.summary()["max_error_last"] <= 1e-3
    assert len(adapted.dynamic_names) == 70 + 21
    assert adapted.min_eig_M_hat.min() > 0.0
    first, last = (np.linalg.norm(adapted.a_k[k] - adapted.a_k_true) for k in (0, -1))
    assert last < 0.1 * first
    assert adapted.lyapunov[-1] < 0.8 * adapted.lyapunov[0]
    coarser = ["controller.adaptation=none", "simulation.duration=2.0", "controller.dt=0.004"]
    unadapted = Scenario.read(PANDA, coarser).run()
    assert unadapted.diverged is None
    assert adapted.summary()["max_error_last"] <= 0.1 * unadapted.summary()["max_error_last"]
    assert "not adapted" not in comparison_table([adapted])
    head, *_, row = comparison_table([replace(adapted, unadapted=0.0123)]).splitlines()
    assert "not adapted [mm]" in head and "12.300" in row


UNLIMITED = [
    "limits.stop_on_divergence=false",
    "limits.guards=false",
    "engine.torque_limits=false",
    "limits.torque=false",
]


def test_panda_with_plain_gradient_loses_its_mass_matrix():
    gradient = [
        "controller.law=adaptive-inverse-dynamics",
        "controller.adaptation=gradient",
        "controller.gamma_d=12.0",
        "simulation.duration=1.0",
    ]
    watched = Scenario.read(PANDA, gradient).run()
    assert watched.diverged < 1.0 and "no longer positive definite" in watched.reason
    assert "adaptive-jacobian" in watched.reason  # which needs no inverse
    assert watched.min_eig_M_hat.min() > 0.0  # the run ends before it is used
    rollout = Scenario.read(PANDA, [*gradient, *UNLIMITED]).run()
    assert watched.diverged < rollout.diverged < 1.0
    assert rollout.min_eig_M_hat.min() < 0.0
    assert 0.0 < rollout.t[-1] < rollout.diverged  # what happened until then is kept


def test_panda_survives_a_start_far_from_its_path():
    """The path begins 23 cm from the tool; the estimates must not blow up between two samples."""
    place = ["trajectory.center=[0.5, 0.0, 0.5]", "trajectory.as_given=true"]
    far = [*place, "simulation.duration=2.0", "controller.dt=0.004"]
    for setting in ("engine.torque_limits=false", "sensors.camera={}"):
        rollout = Scenario.read(PANDA, [*far, setting]).run()
        assert rollout.diverged is None
        assert rollout.distance[0] > 0.2
        assert rollout.summary()["max_error_last"] < 1e-3
