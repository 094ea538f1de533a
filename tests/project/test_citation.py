"""What a controller says to cite: complete BibTeX entries, each once."""

import re

import pytest

import pinadapt as pa
from pinadapt.citation import SOFTWARE, references
from pinadapt.cli.command_line import main
from pinadapt.description.catalogue import robots_folder
from tests.support.parsed import FILES, parsed


def entries(bibtex):
    """Return the entries of a BibTeX text: key -> (kind, fields)."""
    found = {}
    for kind, key, body in re.findall(r"^@(\w+)\{(\S+),\n((?:  .*,\n)*)\}$", bibtex, re.M):
        assert key not in found
        found[key] = kind, dict(re.findall(r"^  (\w+) *= \{(.+)\},$", body, re.M))
    assert len(found) == bibtex.count("@")
    return found


@pytest.mark.parametrize("law", pa.laws.LAWS)
def test_the_entries_of_a_law_are_complete_and_of_its_docstring(law):
    kind_of_law = pa.laws.LAWS[law]
    robot = pa.load("planar_2r", task="joint" if kind_of_law.joint_space else None)
    cited = entries(pa.citation(pa.make_controller(robot, law=law)))
    sources = list(kind_of_law.sources)
    assert sources and list(cited)[: len(sources)] == sources
    assert list(cited)[-2:] == ["Carpentier2019", "pinadapt"]
    assert all({"author", "title", "year"} <= set(fields) for _, fields in cited.values())
    for key in sources:
        year = cited[key][1]["year"]
        surname = cited[key][1]["author"].split(",")[0]
        assert year in kind_of_law.__doc__ and surname in kind_of_law.__doc__


def test_every_source_is_an_entry_and_every_entry_is_a_source():
    in_code = {source for path in FILES for source in parsed(path).sources}
    assert in_code | {*SOFTWARE} == set(references())


def test_the_command_prints_what_a_scenario_uses(capsys):
    scenario = robots_folder() / "planar_2r" / "wang_xie_2009.toml"
    assert main(["cite", str(scenario)]) == 0
    assert "WangXie2009" in entries(capsys.readouterr().out)
