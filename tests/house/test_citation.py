"""Every controller knows what to cite: entries are complete, and each once."""

import re

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.cli.main import main
from pinadapt.description.catalogue import robots_folder

REQUIRED = {
    "article": {"author", "title", "journal", "volume", "pages", "year"},
    "inproceedings": {"author", "title", "booktitle", "year"},
    "book": {"author", "title", "publisher", "year"},
    "techreport": {"author", "title", "institution", "year"},
    "software": {"author", "title", "version", "year"},
}


def entries(bibtex):
    """Return the entries of a BibTeX text: key -> (kind, fields)."""
    found = {}
    for kind, key, body in re.findall(r"^@(\w+)\{(\S+),\n((?:  .*,\n)*)\}$", bibtex, re.M):
        fields = dict(re.findall(r"^  (\w+) *= \{(.+)\},$", body, re.M))
        assert key not in found
        assert len(fields) == body.count("\n"), body
        found[key] = (kind, fields)
    assert len(found) == bibtex.count("@")
    return found


def controller(law, **options):
    """Return a controller of a UR5 with a law."""
    task = "joint" if isinstance(law, str) and pa.LAWS[law].joint_space else "xyz"
    return pa.make_controller(pa.load("ur5", task=task), law=law, **options)


@pytest.mark.parametrize("law", pa.LAWS)
def test_the_entries_of_a_law_are_complete_and_of_its_docstring(law):
    cited = entries(pa.citation(controller(law)))
    sources = [source.key for source in pa.LAWS[law].sources]
    assert sources and list(cited)[: len(sources)] == sources
    assert list(cited)[-2:] == ["Carpentier2019", "pinadapt"]
    for kind, fields in cited.values():
        assert set(fields) >= REQUIRED[kind]
        assert all(value.count("{") == value.count("}") for value in fields.values())
    for key in sources:
        year, surname = cited[key][1]["year"], cited[key][1]["author"].split(",")[0]
        assert year in pa.LAWS[law].__doc__ and surname in pa.LAWS[law].__doc__


def test_the_version_is_cited():
    _, fields = entries(pa.citation(controller("separation")))["pinadapt"]
    assert fields["version"] == pa.__version__


def test_an_adaptation_is_cited_where_it_is_used():
    assert "LeeKwonPark2018" in pa.citation(controller("separation"))
    assert "LeeKwonPark2018" not in pa.citation(controller("separation", adaptation="gradient"))


def test_what_is_wrapped_around_an_adaptation_is_cited_with_it():
    plain, noisy = (pa.citation(controller("separation", encoder=e)) for e in (0.0, 1e-4))
    assert "IoannouKokotovic1984" not in plain  # the leak
    assert {"IoannouKokotovic1984", "LeeKwonPark2018"} < set(entries(noisy))
    assert "IoannouSun1996" in plain  # the box of the kinematic estimate
    assert "IoannouSun1996" not in pa.citation(controller("separation", kinematic_box=False))


def test_own_sources_are_cited():
    thesis = pa.Reference(
        "Me2026",
        {"author": "Me, My", "title": "RLS for SCARA robots", "school": "Mine", "year": "2026"},
        "phdthesis",
    )

    class Own(pa.Gradient):
        sources = (thesis,)

    robot = pa.load("ur5")
    own = pa.make_controller(robot, adaptation=Own(1e-3, 60), joint="none")
    kind, fields = entries(pa.citation(own))["Me2026"]
    assert kind == "phdthesis" and fields["title"] == "{RLS} for {SCARA} robots"


@pytest.mark.parametrize("thing", ["separation", None, np.zeros(3)])
def test_what_is_no_controller_is_refused(thing):
    with pytest.raises(pa.InputError, match="expected a Controller"):
        pa.citation(thing)


def test_the_command_prints_what_a_scenario_uses(capsys):
    scenario = robots_folder() / "planar_2r" / "wang_xie_2009.toml"
    assert main(["cite", str(scenario)]) == 0
    assert "WangXie2009" in entries(capsys.readouterr().out)
