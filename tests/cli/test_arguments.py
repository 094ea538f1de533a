"""Arguments that the command line refuses before anything runs."""

import json

import pytest

from pinadapt.cli.command_line import main
from pinadapt.zoo.experiment import ZooRow


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--robots", " , "], "--robots: at least one name is expected"),
        (["--seed", "-1"], "--seed: a whole number of at least 0 is expected, got -1"),
        (["--processes", "-1"], "--processes: a whole number of at least 0 is expected, got -1"),
        (["--processes", "two"], "--processes: a whole number of at least 0 is expected, got two"),
        (
            ["--law", "resolved-acceleration"],
            "invalid choice: 'resolved-acceleration'",
        ),  # it does not adapt
    ],
)
def test_the_zoo_refuses_invalid_arguments(arguments, words, capsys):
    with pytest.raises(SystemExit) as refused:
        main(["zoo", *arguments])
    assert refused.value.code == 2
    assert words in capsys.readouterr().err


def test_a_robot_named_twice_runs_once(monkeypatch, tmp_path):
    monkeypatch.setattr(
        "pinadapt.cli.zoo.run_zoo",
        lambda names, law, **options: iter([ZooRow(name) for name in names]),
    )
    assert main(["zoo", "--robots", "ur5,panda,,ur5,", "--out", str(tmp_path)]) == 0
    assert [row["robot"] for row in json.loads((tmp_path / "zoo.json").read_text())] == [
        "ur5",
        "panda",
    ]
