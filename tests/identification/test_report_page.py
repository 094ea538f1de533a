"""The web page of an identification: its numbers, its warnings, and that it is self-contained."""

from html.parser import HTMLParser

import numpy as np
import pytest

from pinadapt.identification.report import least_squares_errors
from tests.support.recorded import identified, true_robot

pytestmark = pytest.mark.slow


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
    reader = Reader(identified("ur5").page())
    assert not reader.opened
    assert len(reader.sources) == 2
    assert all(source.startswith("data:image/png;base64,") for source in reader.sources)


@pytest.mark.usefixtures("blank_pictures")
def test_the_table_has_the_errors_of_all_models():
    """The true robot, as another model, predicts to the noise; least squares to nearly that."""
    found, true = identified("ur5"), true_robot("ur5")
    reader = Reader(found.page({"published": true}))
    header = next(cells for cells in reader.rows if "published" in cells)
    total = dict(zip(header, row(reader, "all, rms, N m"), strict=True))
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
