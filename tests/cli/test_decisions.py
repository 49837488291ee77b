"""Decision records: each has a status, and the index lists them all."""

import re

from tests import decisions_page


def test_the_index_of_decisions_is_that_of_the_records():
    assert decisions_page.PAGE.read_text(encoding="utf-8") == decisions_page.page(), (
        "run: python -m tests.decisions_page"
    )


def test_what_supersedes_a_record_is_a_later_record():
    numbers = {one.number for one in decisions_page.records()}
    for one in decisions_page.records():
        for later in map(int, re.findall(r"\[(\d+)\]", one.status)):
            assert one.number < later
            assert later in numbers
