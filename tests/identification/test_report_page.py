"""The web page of an identification: its numbers, its warnings, and that it is self-contained."""

import re
from functools import cache
from html.parser import HTMLParser

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.identification.report_page import least_squares_errors, uncertainty_left
from tests.support.chains import catalogue_robot
from tests.support.recorded import identified, recorded, true_robot

pytestmark = pytest.mark.slow


@cache
def identified_load():
    """Return the identification of the load alone, of an arm that is otherwise as described."""
    told = pa.Unknown(bodies="payload", friction=False, armature=False)
    log = recorded("ur5", noisy=True, duration=6.0)
    return pa.identify(log, catalogue_robot("ur5"), unknown=told)


class Reader(HTMLParser):
    """Collects the rows of tables, and what a page loads or runs."""

    def __init__(self, text):
        super().__init__()
        self.rows, self.opened, self.sources, self.cell = [], [], [], False
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        if tag not in ("meta", "img"):
            self.opened.append(tag)
        self.sources += [value for name, value in attrs if name in ("src", "href")]
        assert tag not in ("script", "link", "iframe")
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")
            self.cell = True

    def handle_endtag(self, tag):
        assert self.opened.pop() == tag
        self.cell &= tag not in ("td", "th")

    def handle_data(self, data):
        if self.cell:
            self.rows[-1][-1] += data


def row(reader, name):
    return next(cells for cells in reader.rows if cells and cells[0] == name)


def test_a_page_is_whole_and_loads_nothing():
    reader = Reader(identified("ur5").page(command="pinadapt excite ur5 & more"))
    assert not reader.opened
    assert len(reader.sources) == 2
    assert all(source.startswith("data:image/png;base64,") for source in reader.sources)


@pytest.mark.usefixtures("blank_pictures")
def test_the_table_has_the_errors_of_all_models():
    """The true robot, as another model, predicts to the noise; least squares to nearly that."""
    found, true = identified("ur5"), true_robot("ur5")
    reader = Reader(found.page({"published": true}))
    header = next(cells for cells in reader.rows if "published" in cells)
    total = dict(zip(header, row(reader, "all, rms"), strict=True))
    errors = found.torque_errors

    def rms(values):
        return f"{np.sqrt(np.mean(np.square(values))):.3g}"

    assert total["described"] == rms(errors.described_held_out)
    assert total["identified"] == rms(errors.learned_held_out)
    last = found.windows.between(found.split, np.inf)
    exact = found.estimator.controller.dynamics.value(true)
    assert total["published"] == rms(last.residual(exact))
    assert float(total["published"]) < 0.1 * float(total["described"])
    plain, weighted = least_squares_errors(found)
    assert (total["OLS"], total["WLS"]) == (rms(plain), rms(weighted))
    assert float(total["WLS"]) < 0.2 * float(total["described"])


@pytest.mark.usefixtures("blank_pictures")
def test_a_better_model_and_doubts_stand_on_top():
    found = identified_load()
    text = found.page({"a published one": true_robot("ur5")})
    warned = re.findall(r'<div class="warning">(.*?)</div>', text)
    assert any("a published one predicts the held-out torques better" in words for words in warned)
    assert text.index('class="warning"') < text.index("<h2>")


def test_another_chain_is_refused():
    with pytest.raises(pa.ParameterError, match="its joints are"):
        identified("ur5").page({"other": catalogue_robot("panda")})


@pytest.mark.usefixtures("blank_pictures")
def test_more_data_leave_less_and_none_leave_all(monkeypatch):
    """Shares are those of (prior^-1 + H)^-1: at most one, and less with an exciting motion."""
    found = identified("ur5")
    after = uncertainty_left(found)
    assert (after > 0.0).all() and (after <= 1.0).all()
    known = dict(zip(found.dynamic.names, after, strict=True))
    assert known["shoulder_lift_joint.viscous"] < 0.1 < known["shoulder_pan_joint.m"]
    found = identified_load()
    after = uncertainty_left(found)
    monkeypatch.setattr("pinadapt.excitation.exciting_motion._ITERATIONS", 5)  # not the best one
    wide = {"duration": 4.0, "harmonics": 2, "excursion": 2.8, "progress": False}
    motion = pa.excite(catalogue_robot("ur5").undrawn(), unknown=found.unknown, **wide)
    besides = uncertainty_left(found, motion.excitation.dynamic)
    assert (besides <= after + 1e-9).all() and besides.mean() < 0.95 * after.mean()
    reader = Reader(found.page(motion=motion, command="pinadapt excite ur5 & more"))
    assert any(
        "body: after the log" in cells and "and the motion" in cells for cells in reader.rows
    )
