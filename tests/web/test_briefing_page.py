"""The briefing as a browser prints it: one page, however long the way is."""

from __future__ import annotations

import re

import msgspec
import pytest

from skyway.web.work.exports import export
from skyway.web.work.planned import plan
from skyway.web.work.question import Question
from tests.web.browsing import chromium

pytestmark = pytest.mark.slow
FAR = {"start": "siuh-north", "depart": "2013-07-10T14:00-04:00"}


@pytest.mark.parametrize(
    "asked",
    [
        {"to": "white-plains"},
        {"to": "40.95,-73.85", "return_to": "home", "dwell": "5min", "if_undelivered": "back"},
        {"to": "40.95,-73.85", "return_to": "home", "drone": "m200"},
    ],
)
@pytest.mark.parametrize("paper", ["A4", "Letter"])
def test_it_is_one_page(tmp_path, asked, paper):
    found = plan(None, msgspec.to_builtins(Question(**FAR, **asked)))["plans"][0]
    contacts = "Operations +1 555 0100\nTower +1 555 0101\nOwner +1 555 0102"
    ((_, content),) = export(None, found["composition"], "html", "briefing", {"contacts": contacts})
    (tmp_path / "briefing.html").write_bytes(content)
    with chromium() as browser:
        tab = browser.new_page()
        tab.goto((tmp_path / "briefing.html").as_uri())
        printed = tab.pdf(format=paper)
    assert len(re.findall(rb"/Type\s*/Page[^s]", printed)) == 1
