"""The command line: exit statuses, messages, and the files that other people's scripts read."""

import json

import numpy as np
import pytest

import pinadapt
from pinadapt.cli.command_line import main
from pinadapt.description.catalogue import robots_folder
from pinadapt.plots.style import Picture

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("blank_pictures")]

PLANAR = str(robots_folder() / "planar_2r" / "wang_xie_2009.toml")
PANDA = str(robots_folder() / "panda" / "tool_and_load.toml")
SHORT = "simulation.duration=0.05"

SUMMARY = {
    "title": str,
    "law": str,
    "adaptation": str,
    "robot": str,
    "nv": int,
    "diverged": (float, type(None)),
    "max_error_first": float,
    "max_error_last": float,
    "rms_error_last": float,
    "tau_max": float,
    "min_eig_M_hat": float,
    "min_singular_J_hat": float,
    "steps": int,
    "wall_time_s": float,
    "step_time_us": float,
    "kinematic_names": list,
    "dynamic_names": list,
    "version": str,
}


def run(scenario, folder, *settings):
    """Run a scenario without animation and return the exit status."""
    return main(["run", scenario, "--no-html", "--out", str(folder), "--set", *settings])


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """Return the folder of a run that ended well."""
    folder = tmp_path_factory.mktemp("finished")
    assert run(PLANAR, folder, SHORT) == 0
    return folder


@pytest.fixture(scope="module")
def diverged(tmp_path_factory):
    """Return the folder of a run that blew up."""
    folder = tmp_path_factory.mktemp("diverged")
    settings = ["law=adaptive-inverse-dynamics", "adaptation=gradient", "gamma_d=1.0"]
    lost = [f"controller.{setting}" for setting in settings]
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(Picture, "png", lambda picture, dpi=100: b"not painted")
        assert run(PANDA, folder, "simulation.duration=1.0", *lost) == 3
    return folder


# --- outputs ---


def test_summary_and_rollout_have_the_documented_keys_and_arrays(finished):
    summary = json.loads((finished / "summary.json").read_text())
    assert not set(SUMMARY) - set(summary)
    assert all(isinstance(summary[key], kind) for key, kind in SUMMARY.items())
    assert (summary["robot"], summary["nv"], summary["steps"], summary["diverged"]) == (
        "planar_2r",
        2,
        50,
        None,
    )
    assert (summary["law"], summary["adaptation"]) == ("adaptive-inverse-dynamics", "natural")
    assert summary["version"] == pinadapt.__version__
    assert 0.1 < summary["max_error_first"] < 0.3
    arrays = np.load(finished / "rollout.npz")
    shapes = {
        "t": (50,),
        "lyapunov": (50,),
        "a_d": (50, 3),
        "a_d_true": (3,),
        "a_k_true": (2,),
    }
    shapes.update(dict.fromkeys(("q", "v", "tau", "x", "x_d", "error", "a_k"), (50, 2)))
    assert {name: arrays[name].shape for name in shapes} == shapes
    assert np.allclose(arrays["a_d_true"], [3.34, 1.2, 0.97])


# --- divergence ---


def test_divergence_leaves_the_outputs_up_to_that_time(diverged):
    summary = json.loads((diverged / "summary.json").read_text())
    arrays = np.load(diverged / "rollout.npz")
    assert 0.0 < summary["diverged"] < 1.0
    assert summary["steps"] == len(arrays["t"]) == len(arrays["tau"]) == len(arrays["a_d"])
    assert np.isclose(arrays["t"][-1] + 1e-3, summary["diverged"])
    assert all(np.isfinite(arrays[name]).all() for name in arrays.files)
    assert all((diverged / f"{name}.png").is_file() for name in ("error", "parameters", "torque"))


# --- refusals ---


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("controller.kv=3.0", "Did you mean 'Kv'?"),
        ("start.a_k=[1.0]", "start.a_k"),
        ("nonsense", "key=value"),
    ],
)
def test_a_refused_input_is_status_2_and_a_message(setting, words, tmp_path, capsys):
    assert run(PLANAR, tmp_path / "out", SHORT, setting) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("pinadapt: ") and words in err and "Traceback" not in err
    assert not (tmp_path / "out").exists()


# --- the other commands ---


def test_a_run_prints_the_load_that_it_found(tmp_path, capsys):
    """A load of 1.5 kg, from two seconds of an exciting motion with noise of the torques."""
    excited = str(robots_folder() / "panda" / "excited_load.toml")
    assert run(excited, tmp_path, "simulation.duration=2.0", "controller.dt=0.002") == 0
    (row,) = (line for line in capsys.readouterr().out.splitlines() if line.startswith("mass "))
    mass, known = (float(part) for part in row.split() if part[0].isdigit())
    assert abs(mass - 1.5) < 3.0 * known < 0.1


def test_view_attaches_to_a_loop_without_a_scenario(capsys, monkeypatch):
    monkeypatch.setattr(pinadapt.Robot, "visual", None)  # nothing is drawn of it
    for display in ("DISPLAY", "WAYLAND_DISPLAY"):  # no browser is started
        monkeypatch.delenv(display, raising=False)
    assert main(["view", "--attach", "9"]) == 2
    assert "9: no answer" in capsys.readouterr().err
    assert main(["view"]) == 2
    assert "is missing" in capsys.readouterr().err


def test_robots_lists_the_catalogue(capsys):
    assert main(["robots"]) == 0
    lines = {line.split()[0]: line for line in capsys.readouterr().out.splitlines()[2:]}
    assert list(lines) == list(pinadapt.catalogue())
    assert lines["panda"].split()[1:4] == ["7", "xyz", "panda_hand_tcp"]
    assert all(
        entry.frame in lines[name] and entry.origin in lines[name]
        for name, entry in pinadapt.catalogue().items()
    )


def test_compare_shows_the_laws_side_by_side(tmp_path, capsys):
    laws = ["resolved-acceleration", "adaptive-jacobian"]
    assert (
        main(["compare", PLANAR, "--laws", ",".join(laws), "--out", str(tmp_path), "--set", SHORT])
        == 0
    )
    rows = capsys.readouterr().out.splitlines()
    assert [law for row in rows for law in laws if law in row] == laws
    summaries = json.loads((tmp_path / "compare.json").read_text())
    assert [summary["law"] for summary in summaries] == laws
    assert all(not set(SUMMARY) - set(summary) for summary in summaries)
    assert all((tmp_path / law / "rollout.npz").is_file() for law in laws)
    assert (tmp_path / "compare.png").read_bytes().startswith(b"\x89PNG")
