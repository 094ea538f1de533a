"""What a controller says to cite: complete BibTeX entries, each once."""

import re
from pathlib import Path

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.citation import SOFTWARE, parse_bibtex, references
from pinadapt.cli.command_line import main
from pinadapt.description.catalogue import robots_folder
from tests.support.parsed import FILES, parsed

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
    task = "joint" if isinstance(law, str) and pa.laws.LAWS[law].joint_space else "xyz"
    return pa.make_controller(pa.load("ur5", task=task), law=law, **options)


@pytest.mark.parametrize("law", pa.laws.LAWS)
def test_the_entries_of_a_law_are_complete_and_of_its_docstring(law):
    cited = entries(pa.citation(controller(law)))
    sources = list(pa.laws.LAWS[law].sources)
    assert sources and list(cited)[: len(sources)] == sources
    assert list(cited)[-2:] == ["Carpentier2019", "pinadapt"]
    for kind, fields in cited.values():
        assert set(fields) >= REQUIRED[kind]
        assert all(value.count("{") == value.count("}") for value in fields.values())
    for key in sources:
        year, surname = cited[key][1]["year"], cited[key][1]["author"].split(",")[0]
        assert year in pa.laws.LAWS[law].__doc__ and surname in pa.laws.LAWS[law].__doc__


def test_the_version_is_cited():
    _, fields = entries(pa.citation(controller("separation")))["pinadapt"]
    assert fields["version"] == pa.__version__


def test_an_adaptation_is_cited_where_it_is_used():
    assert "LeeKwonPark2018" in pa.citation(controller("separation"))
    assert "LeeKwonPark2018" not in pa.citation(controller("separation", adaptation="gradient"))


def test_wrappers_of_an_adaptation_are_cited_with_it():
    plain, noisy = (
        pa.citation(controller("separation", adaptation="natural", sensors=pa.Sensors(encoder=e)))
        for e in (0.0, 1e-4)
    )
    assert "IoannouKokotovic1984" not in plain  # the leak
    assert {"IoannouKokotovic1984", "LeeKwonPark2018"} < set(entries(noisy))
    assert {"Kreisselmeier1977", "LeeKwonPark2018"} < set(
        entries(pa.citation(controller("separation")))
    )
    assert "IoannouSun1996" in plain  # the box of the kinematic estimate
    assert "IoannouSun1996" not in pa.citation(
        controller("separation", limits=pa.Limits(box=False))
    )


class Own(pa.adaptation.Gradient):
    """An adaptation with a source of its own, and one of the library."""

    sources = (
        """
        @phdthesis{Me2026,
          author = {Me, My},
          title  = {{RLS} for {SCARA} robots},
          school = {Mine},
          year   = {2026},
        }
        """,
        "IoannouSun1996",
    )


def test_own_entries_are_cited_as_they_are_written():
    own = controller(
        "separation", adaptation=Own(1e-3, 60), unknown=pa.Unknown(friction=False, armature=False)
    )
    found = entries(pa.citation(own))
    kind, fields = found["Me2026"]
    assert kind == "phdthesis" and fields["title"] == "{RLS} for {SCARA} robots"
    assert list(found).index("IoannouSun1996") == list(found).index("Me2026") + 1


@pytest.mark.parametrize(
    ("source", "words"),
    [
        ("IoannouSun1995", r"no entry 'IoannouSun1995' in references.bib. Did you mean 'Ioan"),
        ("@book{Me2026, title = {Mine}", "'Me2026' has no closing brace"),
        ("@book{Me2026, title = {Mine}}\n@book{Me2026, title = {Mine}}", "two entries have"),
    ],
)
def test_sources_that_cannot_be_cited_are_refused(source, words):
    own = Own(1e-3, 60)
    own.sources = (source,)
    with pytest.raises(pa.InputError, match=words):
        pa.citation(
            controller(
                "separation", adaptation=own, unknown=pa.Unknown(friction=False, armature=False)
            )
        )


def test_every_source_is_an_entry_and_every_entry_is_a_source():
    in_code = {source for path in FILES for source in parsed(path).sources}
    assert in_code | {*SOFTWARE} == set(references())


def test_the_file_is_plain_bibtex():
    """Each entry is complete by a second reader, and nothing but comments stands between them."""
    text = (Path(pa.__file__).parent / "references.bib").read_text(encoding="utf-8")
    read = entries(text[text.index("\n@") + 1 :])
    assert list(read) == list(references())
    assert all(set(fields) >= REQUIRED[kind] for kind, fields in read.values())
    assert "".join(references().values()).count("\n@") == len(read) - 1


def test_entries_of_any_layout_are_read():
    text = 'by hand @home\n @Book { a:1 , title={{T} {{U}}} }\n@misc{b, note = "c"}@misc{no,}'
    found = {"a:1": "@Book { a:1 , title={{T} {{U}}} }\n", "b": '@misc{b, note = "c"}\n'}
    assert parse_bibtex(text) == found and parse_bibtex("") == {}


@pytest.mark.parametrize("thing", ["separation", None, np.zeros(3)])
def test_only_controllers_can_be_cited(thing):
    with pytest.raises(pa.InputError, match="expected a Controller"):
        pa.citation(thing)


def test_the_command_prints_what_a_scenario_uses(capsys):
    scenario = robots_folder() / "planar_2r" / "wang_xie_2009.toml"
    assert main(["cite", str(scenario)]) == 0
    assert "WangXie2009" in entries(capsys.readouterr().out)
