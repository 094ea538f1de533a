"""Values, designs and numbered cases: what they are, and what is refused."""

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.sweep import Plan
from pinadapt.sweep.cases import Values

SCENARIO = """
[robot]
source = "planar_2r"
[truth]
friction = { viscous = [0.1, 0.2], coulomb = 0.0 }
[simulation]
duration = 0.02
"""


def cases_of(vary, **options):
    """Return the cases of a function."""
    return Plan.of({"function": dict, "vary": vary, **options}).cases


@pytest.fixture
def scenario(tmp_path):
    (tmp_path / "scenario.toml").write_text(SCENARIO)
    return tmp_path / "scenario.toml"


@pytest.mark.parametrize(
    ("given", "axis"),
    [
        ([1, 2.5], [1, 2.5]),
        (3.0, [3.0]),
        (range(3), [0, 1, 2]),
        ("lin(0, 1, 3)", [0.0, 0.5, 1.0]),
        ("log(1, 100, 3)", [1.0, 10.0, 100.0]),
        ("['a', 'b']", ["a", "b"]),
        ("a, b-c", ["a", "b-c"]),
    ],
)
def test_lists_and_ranges(given, axis):
    found = Values.of("k", given)
    assert not found.drawn and list(found.arguments) == axis


def test_a_grid_with_samples_and_repetitions_is_their_product_in_order():
    cases = cases_of({"a": [1, 2], "b": "uniform(0, 1)", "c": [5, 6, 7]}, samples=4, repeat=2)
    assert len(cases) == 2 * 3 * 4 * 2 == len(list(cases))
    found = [(case.values["a"], case.values["c"]) for case in cases]
    assert found[:8] == [(1, 5)] * 8 and found[8] == (1, 6) and found[-1] == (2, 7)
    b = [case.values["b"] for case in cases]
    assert b[0] == b[1] != b[2] and b[:8] == b[8:16]  # every point of the grid has the same samples
    seeds = [case.seed for case in cases]
    assert len(set(seeds)) == len(seeds) and max(seeds) < 2**63
    assert seeds[3] == np.random.SeedSequence(0, spawn_key=(0, 3)).generate_state(1, np.uint64) >> 1


def test_a_case_follows_from_its_number_alone():
    cases = cases_of({"a": "normal(1, 2)"}, samples=50, seed=3)
    assert [cases[i] for i in range(49, -1, -1)] == list(cases)[::-1]
    assert cases[7] == cases_of({"a": "normal(1, 2)"}, samples=90, seed=3)[7]
    assert cases[7] != cases_of({"a": "normal(1, 2)"}, samples=50, seed=4)[7]


@pytest.mark.parametrize("method", ["random", "lhs", "sobol"])
def test_distributions_have_the_stated_moments(method):
    given = {
        "u": "uniform([0, 10], [1, 20])",
        "l": "loguniform(1, 10000)",
        "n": "normal(5, 2)",
        "c": "choice(['a', 'b'])",
    }
    values = [case.values for case in cases_of(given, samples=1024, method=method)]
    u = np.array([each["u"] for each in values])
    assert u.shape == (1024, 2) and (u >= [0, 10]).all() and (u <= [1, 20]).all()
    close = 0.1 if method == "random" else 0.02
    assert np.mean(u, axis=0) == pytest.approx([0.5, 15.0], rel=close)
    assert np.median([each["l"] for each in values]) == pytest.approx(100.0, rel=4 * close)
    n = np.array([each["n"] for each in values])
    assert (n.mean(), n.std()) == (pytest.approx(5.0, rel=close), pytest.approx(2.0, rel=close))
    assert np.mean([each["c"] == "a" for each in values]) == pytest.approx(0.5, abs=close)


# --- keys of a scenario ---


def plan(scenario, *vary, **options):
    return Plan.read(scenario, vary, **options)


def test_an_asterisk_gives_each_joint_a_number_as_list_or_table(scenario):
    listed = plan(scenario, "truth.friction.coulomb.*=uniform(0, 1)", samples=3).cases[0].values
    assert len(listed["truth.friction.coulomb"]) == 2
    table = plan(scenario, "model.inertial_scale.*=normal(1, 0.1)", samples=3).cases[0].values
    assert list(table["model.inertial_scale"]) == ["joint1", "joint2"]


@pytest.mark.parametrize(
    ("vary", "words"),
    [
        ("truth.payload.mas=[1.0]", "Did you mean 'mass'"),
        ("contrller.alpha=[1.0]", "Did you mean 'controller'"),
        ("controller.adaptation=['naturel']", "Did you mean 'natural'"),
        ("engine.dt=[-1.0]", "engine.dt: must be positive"),
        ("controller.dt", "expected key=value"),
        ("controller.dt=[0.001", "controller.dt: cannot be read"),
    ],
)
def test_keys_and_values_that_a_scenario_refuses_are_refused_before_anything_runs(
    vary, words, scenario
):
    with pytest.raises(pa.InputError, match=words):
        plan(scenario, vary)


def test_a_sweep_file_and_its_copy_define_the_same_sweep(scenario, tmp_path):
    file = tmp_path / "sweep_file.toml"
    file.write_text(
        'title = "T"\nscenario = "scenario.toml"\nsamples = 3\nmethod = "lhs"\nseed = 4\n'
        'success = "error_share < 0.5"\n[set]\nsimulation.seed = 2\n[vary]\n'
        'truth.payload.mass = "uniform(0.1, 0.2)"\ncontroller.law = ["separation"]\n'
        "[[case]]\ntrajectory.radius = 0.05\n[[case]]\ntrajectory.radius = 0.06\n"
    )
    found = Plan.read(file)
    assert len(found.cases) == 6 and found.method == "lhs"
    assert found.scenario["simulation"] == {"duration": 0.02, "seed": 2}
    (tmp_path / "out").mkdir()
    found.save(tmp_path / "out")
    again = Plan.load(tmp_path / "out")
    assert found.is_in(tmp_path / "out") and again.cases == found.cases
    assert Plan.read(file, success="follows").is_in(tmp_path / "out")
    other = Plan.read(file, ["trajectory.period=[3.0]"], seed=5)
    assert not other.is_in(tmp_path / "out")
