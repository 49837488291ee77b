"""The frame of every page: head, navigation, preferences, and the address that keeps what a person asked for."""

from __future__ import annotations

import json
from contextlib import contextmanager
from typing import TYPE_CHECKING
from urllib.parse import urlencode

from nicegui import Client, ui

from skyway import __version__
from skyway.web.controls import text
from skyway.web.preferences import CHOICES, Preferences

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from skyway.web.site import Site

PAGES = (
    ("/", "Plan"),
    ("/missions", "Missions"),
    ("/recharge", "Recharge"),
    ("/fly", "Fly"),
    ("/fleet", "Fleet"),
    ("/replay", "Replay"),
    ("/history", "History"),
)
"""Address and name of each page."""


def add(site: Site, address: str, make: Callable[[Site, Client, Preferences], object]) -> None:
    """Add a page of `PAGES`; `make` lays out its main part for each browser that opens it."""

    @ui.page(address, title=f"skyway: {dict(PAGES)[address].lower()}")
    async def opened(client: Client) -> None:
        with page(site, client, address) as wanted:
            make(site, client, wanted)


@contextmanager
def page(site: Site, client: Client, here: str) -> Iterator[Preferences]:
    """Lay out a page; elements made inside are its main part. Yields the person's preferences."""
    del site
    wanted = Preferences.of(client.request.cookies)
    ui.add_head_html(
        f'<link rel="stylesheet" href="/static/page.css?{__version__}"><script src="/static/page.js?{__version__}"></script>'
    )
    with ui.element("div").classes("site"):
        with ui.element("div").classes("bar"):
            text("a", "Skip to the page", "skip", href="#main")
            text("h1", "skyway", "brand")
            with ui.element("nav").props('aria-label="Pages"'):
                for address, name in PAGES:
                    text("a", name, href=address, **({"aria-current": "page"} if address == here else {}))
            text("span", "", "where")
            for name, (words, choices) in CHOICES.items():
                _preference(name, words, choices, getattr(wanted, name))
        with (
            ui.element("div").classes("main").props("id=main tabindex=-1")
        ):  # the main landmark is NiceGUI's own element around all
            yield wanted


def remember(client: Client, here: str, asked: Mapping[str, str]) -> None:
    """Keep a request in the address of a page: it is there after a reload or a restart of the server, and can be stored and sent."""
    address = json.dumps(f"{here}?{urlencode(asked)}" if asked else here)
    client.run_javascript(f"history.replaceState(history.state, '', {address})")


def _preference(name: str, words: str, choices: dict[str, str], chosen: str) -> None:
    """A choice that the browser remembers; ``static/page.js`` does."""
    with ui.element("select").classes("pref").props(f'data-preference={name} aria-label="{words}"'):
        for value, label in choices.items():
            option = text("option", label, value=value)
            if value == chosen:
                option.props("selected")
