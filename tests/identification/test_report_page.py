"""The web page of an identification: its numbers, its warnings, and that it is self-contained."""

from html.parser import HTMLParser

import pytest

from tests.support.recorded import identified

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


def test_a_page_is_whole_and_loads_nothing():
    reader = Reader(identified("ur5").page())
    assert not reader.opened
    assert len(reader.sources) == 1
    assert all(source.startswith("data:image/png;base64,") for source in reader.sources)
