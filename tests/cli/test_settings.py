"""Settings at the command line, and the page that lists them."""

import json

import settings_page

TRIP = (
    "--from",
    "bellevue",
    "--to",
    "jacobi",
    "--payload",
    "0.8",
    "--depart",
    "2013-07-10T14:00-04:00",
    "--wind",
    "8@270",
)


def test_the_page_of_settings_is_that_of_the_code():
    assert settings_page.PAGE.read_text(encoding="utf-8") == settings_page.page(), (
        "run: python tests/cli/settings_page.py"
    )


def test_settings_are_listed_for_people_and_programs(skyway):
    assert "planner.robust.members" in skyway("settings", "planner.robust").out
    listed = json.loads(skyway("settings", "--json").out)["settings"]
    members = next(one for one in listed if one["name"] == "planner.robust.members")
    assert (members["default"], members["low"], members["high"]) == (30, 1, 1000)
    assert skyway("settings", "planer").code == 2


def test_a_plan_takes_settings_and_keeps_them(skyway):
    answer = skyway("plan", *TRIP, "--planner", "pfs", "--set", "planner.schedule.max_diverts=1", "--json")
    document = json.loads(answer.out)
    assert document["parameters"] == {"planner.schedule.max_diverts": "1"}
    assert max(len(leg["diverts"]) for leg in document["legs"]) == 1


def test_a_setting_that_is_not_there_is_told_before_anything_is_planned(skyway):
    answer = skyway("compare", *TRIP, "--set", "planner.robust.member=3")
    assert answer.code == 2
    assert "near it: planner.robust.members" in answer.err
