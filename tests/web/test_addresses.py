"""What a person asked for is in the address of each page: it stays after a reload, another unit, or a restart of the server."""

from __future__ import annotations

import pytest

from skyway.models.ledger.opening import open_ledger
from tests.web.browsing import chromium, person
from tests.web.conftest import served
from tests.web.test_recharge_page import PADS, mission

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def browser():
    with chromium() as found:
        yield found


def choose(tab, name, value):
    tab.get_by_role("combobox", name=name, exact=True).select_option(value)


def chosen(tab, name, value):
    """Wait until a list shows a value."""
    tab.wait_for_function(
        """([name, value]) => [...document.querySelectorAll('.field')].some((one) =>
            one.querySelector('label').textContent === name && one.querySelector('select, input')?.value === value)""",
        arg=[name, value],
    )


def in_address(tab, words):
    tab.wait_for_function("(words) => location.search.includes(words)", arg=words)


def test_the_recharge_page_keeps_its_mission_and_its_pads(browser, site):
    (site.folder / "long.plan").write_text(mission())
    (site.folder / "pads.csv").write_text(PADS)
    with person(browser, site.address, "/recharge") as tab:
        choose(tab, "Mission", "long.plan")
        choose(tab, "Pads", "pads.csv")
        tab.wait_for_selector("dl.figures")
        tab.get_by_label("The ground of all pads is as high as home").check()
        tab.get_by_label("Place", exact=True).fill("47.4,8.55")
        tab.get_by_role("button", name="Put it there").click()
        tab.wait_for_selector(".chips .chip")
        tab.wait_for_function("document.querySelector('#recharge-command').textContent.includes('--level-ground')")
        in_address(tab, "47.4")
        command = tab.inner_text("#recharge-command")
        with tab.expect_navigation():
            tab.get_by_label("Times", exact=True).select_option("utc")
        tab.wait_for_selector("dl.figures")
        tab.wait_for_function("(was) => document.querySelector('#recharge-command').textContent === was", arg=command)
        assert tab.locator(".chips .chip").count() == 1


def test_the_missions_page_keeps_its_mission_and_what_it_is_checked_for(browser, site):
    (site.folder / "long.plan").write_text(mission())
    with person(browser, site.address, "/missions") as tab:
        choose(tab, "Missions in the work folder", "long.plan")
        tab.get_by_label("Reserve").fill("35")
        tab.get_by_label("Reserve").press("Tab")
        in_address(tab, "reserve=35")
        tab.reload()
        tab.wait_for_function("document.querySelector('#mission-command').textContent.includes('--reserve 35')")
        chosen(tab, "Missions in the work folder", "long.plan")
        assert tab.get_by_label("Reserve").input_value() == "35"


def test_the_replay_and_fleet_pages_keep_their_files(browser, site, pages):
    for name in ("a.csv", "b.csv"):
        (site.folder / name).write_text("no log")
    for name in ("one.db", "two.db"):
        open_ledger(str(site.folder / name)).close()
    with person(browser, site.address, "/replay", minds=False) as tab:
        chosen(tab, "Log", "")
        choose(tab, "Log", "b.csv")
        choose(tab, "Beside it", "a.csv")
        in_address(tab, "beside=a.csv")
        tab.reload()
        chosen(tab, "Log", "b.csv")
        chosen(tab, "Beside it", "a.csv")
    with person(browser, site.address, "/fleet", minds=False) as tab:
        choose(tab, "Ledger", "two.db")
        tab.get_by_label("Dispatcher").fill("north")
        tab.get_by_label("Dispatcher").press("Tab")
        in_address(tab, "ledger=two.db&holder=north")
        site.kill()
        pages[:] = [served(site.folder, "--port", str(site.port))]
        tab.reload()
        chosen(tab, "Ledger", "two.db")
        assert tab.get_by_label("Dispatcher").input_value() == "north"
