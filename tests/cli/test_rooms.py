"""Rooms: small, shown on a page that is made from the code."""

from __future__ import annotations

from collections import Counter

from tests import rooms_page

MAX_MODULES = 15


def test_the_page_and_the_picture_of_the_rooms_are_those_of_the_code():
    remedy = "run: python -m tests.rooms_page"
    assert rooms_page.PAGE.read_text(encoding="utf-8") == rooms_page.page(), remedy
    assert rooms_page.PICTURE.read_text(encoding="utf-8") == rooms_page.picture(), remedy


def test_no_room_has_grown_too_large_to_look_over():
    counts = Counter(one.room for one in rooms_page.modules())
    assert counts
    assert {room: count for room, count in counts.items() if count > MAX_MODULES} == {}


def test_every_room_and_every_module_says_what_it_is_for():
    found = rooms_page.modules()
    assert [room for room, says in rooms_page.rooms(found).items() if not says] == []
    assert [one.name for one in found if not one.says] == []
