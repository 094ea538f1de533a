"""Torques whose gains are off: a load by difference covers them, a known load shows them."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.cli.command_line import main
from pinadapt.description.chain import effort_limits
from tests.support.chains import catalogue_robot
from tests.support.recorded import motion, torques

pytestmark = [
    pytest.mark.slow,
    pytest.mark.usefixtures("blank_pictures", "shortened"),
]

MASS = 2.805
LOAD = pa.Payload(MASS, (0.02, -0.01, 0.05), (0.01, 0.0, 0.012, 0.0, 0.0, 0.004))
GAINS = np.array([1.0, 0.96, 1.05, 1.0, 0.97, 1.04, 1.0])
TOLD = pa.Unknown(friction=True, armature=False)


@cache
def arm():
    """Return an arm whose bodies are not as described."""
    robot = catalogue_robot("panda")
    rng = np.random.default_rng(3)
    scale = dict(zip(robot.joint_names, rng.uniform(0.8, 1.3, 7).tolist(), strict=True))
    return robot.changed(inertial_scale=scale, viscous=0.5, coulomb=0.8)


@cache
def log(*, loaded):
    """Return a log with 1 % of the effort limits as noise of the torques, and without."""
    true = arm().changed(payload=LOAD) if loaded else arm()
    seed = 1 + loaded
    t, q, v, a = motion("panda", duration=8.0, dt=8e-3, seed=seed)
    tau = torques(true, q, v, a)
    noise = 0.01 * effort_limits(true.model) * np.random.default_rng(seed).standard_normal(q.shape)
    return pa.Log(t, q, tau + noise, v, tuple(true.joint_names), source="log")


@cache
def identified(*, known, wrong):
    """Return what is identified from the logs, with or without gains that are wrong."""
    both = [
        replace(one, tau=one.tau * (GAINS if wrong else 1.0))
        for one in (log(loaded=True), log(loaded=False))
    ]
    robot = catalogue_robot("panda")
    mass = MASS if known else None
    return pa.identify(both[0], robot, empty=both[1], known_load=mass, unknown=TOLD)


def errors(found):
    """Return rms errors of the masses [kg], and of the torques of the bodies, as a share."""
    true = arm().changed(payload=LOAD, armature=0.0, friction=pa.Friction())
    a = found.controller.dynamics.inertial.value(true)
    off = found.dynamic.estimate[: a.size] - a
    masses = slice(0, None, 10)
    W = found.windows.W[:, :, : a.size]
    return np.sqrt(np.mean(off[masses] ** 2)), np.linalg.norm(W @ off) / np.linalg.norm(W @ a)


def test_a_known_load_shows_the_gains_of_the_torques():
    found = identified(known=True, wrong=True)
    plain = identified(known=False, wrong=True)
    gains = found.gains.estimate
    known = found.gains.deviations
    shown = known < 0.012
    assert shown[[1, 3, 4, 5]].all() and (known < 0.051).all() and known[0] > 0.012
    assert np.abs(gains - GAINS)[shown].max() < 0.015
    assert (np.abs(gains - GAINS) < 3.0 * known).all()
    (masses, torque), (masses_before, torque_before) = errors(found), errors(plain)
    assert masses < masses_before and torque < 0.3 * torque_before
    load = found.payload()
    assert load.mass == pytest.approx(MASS, rel=1e-3)
    assert (np.abs(load.com - LOAD.com) < 3.0 * load.com_known_to).all()
    assert np.abs(load.com - LOAD.com).max() < 3e-3
    assert found.torque_errors.gain > 1.05 * plain.torque_errors.gain
    rows = found.summary()["gains"]
    assert [row["value"] for row in rows] == gains.tolist()
    assert rows[1]["name"] == "panda_joint2.gain" and "panda_joint2.gain" in str(found)


def test_right_gains_stay_right():
    found = identified(known=True, wrong=False)
    plain = identified(known=False, wrong=False)
    assert (np.abs(found.gains.estimate - 1.0) < 3.0 * found.gains.deviations).all()
    load = plain.payload()  # by gains of 5 %, whatever the share of noise
    assert abs(load.mass - MASS) < 2.0 * load.mass_known_to < 0.1 * MASS
    assert errors(found)[1] < errors(plain)[1] + 3e-3  # to which the gains are known
    assert np.allclose(found.torque_errors.learned_held_out, plain.torque_errors.learned_held_out,
                       rtol=0.1)  # fmt: skip
    assert plain.gains is None and not plain.summary()["gains"]


def test_a_load_that_the_torques_do_not_show_is_refused():
    """Half of it, and the load of the empty arm, as the logs are swapped."""
    robot = catalogue_robot("panda")
    both = (log(loaded=True), log(loaded=False))
    given = {"unknown": TOLD}
    with pytest.raises(pa.ParameterError, match=r"known_load: .* the torques show 2\.8"):
        pa.identify(both[0], robot, empty=both[1], known_load=0.5 * MASS, **given)
    with pytest.raises(pa.ParameterError, match=r"the torques show -2\..*swapped"):
        pa.identify(both[1], robot, empty=both[0], known_load=MASS, **given)
    with pytest.raises(pa.InputError, match="known_load"):
        pa.identify(both[0], robot, empty=both[1], known_load=0.0)


def test_the_command_takes_a_known_load(tmp_path, capsys):
    for loaded in (True, False):
        one = log(loaded=loaded)
        tau = GAINS * one.tau
        np.savez(tmp_path / f"{loaded}.npz", t=one.t, q=one.q, v=one.v, tau=tau)
    first = ["identify", str(tmp_path / "True.npz"), "--robot", "panda", "--joint", "coulomb"]
    first += ["--known-load", str(MASS), "--out", str(tmp_path / "out")]
    assert main(first) != 0
    assert "--empty" in capsys.readouterr().err
    assert main([*first, "--empty", str(tmp_path / "False.npz")]) == 0
    assert "panda_joint4.gain" in capsys.readouterr().out
