"""Missions in a real browser: mended, compared with what a simulated vehicle holds, uploaded and read back."""

from __future__ import annotations

import json

import pytest

from skyway.missions import Mission, MissionDocument, MissionItem, read, write
from skyway.missions.items.altitude_frames import Frame
from skyway.missions.items.commands import Command
from tests.web.browsing import WIDER, chromium, person
from tests.web.simulated import simulated

pytestmark = pytest.mark.slow


def mission(path, *, height_m=50.0, corners=24):
    """A way with many corners, which ends with a landing; its third item has a value that the vehicle would take for 0."""
    place = {"frame": Frame.GLOBAL_RELATIVE_ALT, "y": -740_660_000, "z": height_m}
    items = [MissionItem(Command.NAV_TAKEOFF, **place, x=407_190_000)]
    items += [MissionItem(Command.NAV_WAYPOINT, **place, x=407_190_000 + 10_000 * n) for n in range(1, corners)]
    items.append(MissionItem(Command.NAV_LAND, **(place | {"z": 0.0}), x=407_190_000 + 10_000 * corners))
    write(MissionDocument(Mission(items=tuple(items))), path)


def chosen(tab, name, words, drone):
    """Choose a file, of which these words are told, and a vehicle for it."""
    tab.get_by_label("Missions in the work folder").select_option(name)
    tab.locator(".answer .big").filter(has_text=words).wait_for()
    tab.get_by_label("Connection").fill(drone)
    tab.get_by_label("Connection").press("Tab")


def told(tab, words):
    tab.locator(".form .status").filter(has_text=words).wait_for()


def test_a_mission_is_compared_uploaded_read_back_and_compared_again(page):
    mission(page.folder / "patrol.plan")
    mission(page.folder / "higher.plan", height_m=65.0)
    with chromium() as browser, simulated("jersey-city") as vehicle, person(browser, page.address, "/missions") as tab:
        chosen(tab, "patrol.plan", "patrol.plan", vehicle.drone)
        tab.get_by_role("button", name="Compare with the vehicle").click()
        told(tab, "they differ")
        tab.get_by_role("button", name="Upload and read back").click()
        told(tab, "confirm it above")  # nothing was sent yet
        tab.get_by_label("I am sure").check()
        tab.evaluate("""() => { window.seen = []; const bar = document.querySelector('progress');
            new MutationObserver(() => window.seen.push([bar.value, bar.max])).observe(bar, {attributes: true}); }""")
        tab.get_by_role("button", name="Upload and read back").click()
        told(tab, "upload: done")
        count = len(read(page.folder / "patrol.plan").mission.items)
        seen = tab.evaluate("window.seen")
        assert [count, count] in seen
        steps = [done for done, most in seen if most == count]
        assert 0 < steps[0] < count == steps[-1]  # sent, then read back, as fast as a page shows it
        tab.get_by_role("button", name="Compare with the vehicle").click()
        told(tab, "verify: done: both are equal")
        tab.get_by_label("Missions in the work folder").select_option("higher.plan")
        tab.locator(".answer .big").filter(has_text="higher.plan").wait_for()
        tab.get_by_role("button", name="Compare with the vehicle").click()
        told(tab, "they differ")
        rows = tab.locator("table.differences tbody tr")
        assert rows.count() >= count - 1
        assert "65" in rows.nth(1).inner_text()
        assert "50" in rows.nth(1).inner_text()


def test_a_mission_with_errors_is_uploaded_only_if_that_is_chosen_and_each_upload_is_confirmed(page):
    mission(page.folder / "low.plan", height_m=-5.0, corners=3)
    mission(page.folder / "fine.plan", corners=3)
    with chromium() as browser, simulated("jersey-city") as vehicle, person(browser, page.address, "/missions") as tab:
        chosen(tab, "low.plan", "error", vehicle.drone)
        sure, upload = tab.get_by_label("I am sure"), tab.get_by_role("button", name="Upload and read back")
        sure.check()
        upload.click()
        told(tab, "upload: not done")
        assert "nothing was sent" in tab.locator("pre.output").inner_text()
        tab.wait_for_function("(box) => !box.checked", arg=sure.element_handle())
        tab.get_by_label("Upload it although the check finds errors").check()
        sure.check()
        upload.click()
        told(tab, "upload: done")
        tab.wait_for_function("(box) => !box.checked", arg=sure.element_handle())
        sure.check()
        tab.get_by_label("Missions in the work folder").select_option("fine.plan")
        tab.locator(".answer .big").filter(has_text="fine.plan").wait_for()
        tab.wait_for_function("(box) => !box.checked", arg=sure.element_handle())
        upload.click()
        told(tab, "confirm it above")
        tab.set_viewport_size({"width": 390, "height": 844})
        assert tab.evaluate(WIDER) == []


def test_what_is_certain_is_mended_as_a_new_file(page):
    path = page.folder / "fraction.plan"
    mission(path)
    plan = json.loads(path.read_text())
    plan["mission"]["items"][2]["params"][1] = None  # not given: the vehicle takes 0
    path.write_text(json.dumps(plan))
    with chromium() as browser, person(browser, page.address, "/missions?file=fraction.plan") as tab:
        tab.get_by_text("(can be corrected automatically)").first.wait_for()
        tab.locator("table [data-item]").first.click()
        tab.get_by_role("button", name="Fix what is certain").click()
        tab.locator(".answer .status").filter(has_text="saved fraction-2.plan").wait_for()
        assert tab.get_by_text("(can be corrected automatically)").count() == 0
    assert read(page.folder / "fraction-2.plan").mission.items[2].param2 == 0.0
