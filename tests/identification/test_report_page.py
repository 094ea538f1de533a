"""The web page of an identification is self-contained."""

import re

import pytest

from tests.support.recorded import identified

pytestmark = pytest.mark.slow


def test_a_page_is_whole_and_loads_nothing():
    page = identified("ur5").page()
    assert page.startswith("<!DOCTYPE html>") and page.rstrip().endswith("</html>")
    assert not re.search("<(script|link|iframe)", page)
    (source,) = re.findall(r'(?:src|href)="([^"]*)"', page)
    assert source.startswith("data:image/png;base64,")
