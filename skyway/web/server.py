"""The server of the page: one process that answers browsers, and others that compute."""

from __future__ import annotations

import gc
import os
import socket
from contextlib import closing, suppress
from dataclasses import dataclass, field
from ipaddress import ip_address
from pathlib import Path
from typing import TYPE_CHECKING

from skyway.models.base.errors import InputError
from skyway.web.guard import LOOPBACK, Guard
from skyway.web.tiles.base import BaseMap
from skyway.web.work.outline import shapes
from skyway.web.work.weather_and_zones import Given

if TYPE_CHECKING:
    from collections.abc import Callable

MAX_CONNECTIONS = 512
"""Simultaneous connections; more are refused. Idle ones are closed earlier, see `connections`."""
MIN_TOKEN = 12
"""Characters of a token."""
WASTE = (2_000, 10, 10)
"""Numbers of objects, and of rounds, that trigger garbage collection; a page is some 4,000 objects."""
RECONNECT_S = 30.0
"""A browser that reconnects within this time finds its page unchanged."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ServeOptions:
    """Options of the server."""

    scenario: Path | None = None
    """Scenario folder; None is New York, built in."""
    folder: Path = Path()
    """Work folder: the only place where plans, missions, journals and logs are read and written."""
    host: str = "127.0.0.1"
    port: int = 8080
    token: str | None = None
    demo: bool = False
    """Whether a simulated delivery is flown from the start."""
    begins_at: str = ""
    """Path of the page that the printed address opens; empty is the first one."""
    ends: str = "the page, not a flight"
    """Description of what Ctrl-C ends."""
    given: Given = field(default_factory=Given)
    """Current weather and pads, terrain, zones."""
    base: BaseMap = field(default_factory=BaseMap)
    """The layer beneath everything."""
    outline: Path | None = None
    """GeoJSON with coast, water and streets, drawn beneath the network."""

    def checked(self) -> ServeOptions:
        """Return the same, or raise an `InputError` with the unsafe or missing option."""
        if not self.folder.is_dir():
            raise InputError("no such folder", str(self.folder), field="--folder", remedy="create it first")
        if self.scenario is not None and not self.scenario.is_dir():
            raise InputError(
                "no such folder", str(self.scenario), remedy="skyway scenario init DIR writes one to start from"
            )
        self.base.checked()
        if self.outline is not None:
            shapes(str(self.outline))
        if self.demo and self.scenario is not None:
            remedy = "remove one of them"
            raise InputError(
                "the demonstration flies in New York, which is built in",
                str(self.scenario),
                field="--demo",
                remedy=remedy,
            )
        if not 0 <= self.port <= 65535:
            raise InputError("out of range", field="--port", value=self.port, remedy="1 to 65535; 0 takes a free one")
        if self.token is not None and len(self.token) < MIN_TOKEN:
            remedy = f"{MIN_TOKEN} characters or more, such as: openssl rand -hex 16"
            raise InputError("is too short to be safe", field="--token", remedy=remedy)
        if self.token is None and not _is_loopback(self.host):
            remedy = (
                "give --token, which each browser is asked for once; or leave --host at 127.0.0.1 and put a reverse proxy "
                "with a login and TLS before it"
            )
            raise InputError("others can reach this address", field="--host", value=self.host, remedy=remedy)
        return self


def _is_loopback(host: str) -> bool:
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return host in LOOPBACK


def serve(options: ServeOptions, say: Callable[[str], None]) -> None:
    """Serve the page until Ctrl-C; an `InputError` if the address is taken."""
    options = options.checked()
    os.environ.setdefault("NICEGUI_STORAGE_PATH", os.devnull)  # nothing of NiceGUI's is kept on disk
    import uvicorn

    from skyway.web.site import Site

    listening = _listening(options)
    site = Site(options)
    site.start()  # they load their libraries while this process loads its own
    from skyway.web.application import application
    from skyway.web.connections import Prompt

    app = Guard(application(site), options.token, tiles=options.base)
    config = uvicorn.Config(
        app, log_level="warning", access_log=False, server_header=False, date_header=False, limit_concurrency=MAX_CONNECTIONS,
        timeout_keep_alive=30, timeout_graceful_shutdown=2, http=Prompt, ws_max_size=4 * 2**20, lifespan="on", ws="websockets-sansio",
    )  # fmt: skip
    shown = f"[{options.host}]" if ":" in options.host else options.host
    address = f"http://{shown}:{listening.getsockname()[1]}{options.begins_at or ('/fly' if options.demo else '')}"
    say(f"skyway: open {address} in a browser; Ctrl-C ends {options.ends}")
    if options.base.origin is not None:
        say(f"skyway: browsers fetch the base map from {options.base.origin}, as --tiles says")
    look_for_waste()
    with listening, closing(site.workers), suppress(KeyboardInterrupt):  # Ctrl-C is how it ends
        uvicorn.Server(config).run(sockets=[listening])


def look_for_waste() -> None:
    """Collect the objects of closed pages soon: by default Python collects rarely, and would keep half a megabyte of each page that was ever opened."""
    gc.freeze()  # loaded modules stay
    gc.set_threshold(*WASTE)


def _listening(options: ServeOptions) -> socket.socket:
    """Bind the address before anything heavy is loaded."""
    family = socket.AF_INET6 if ":" in options.host else socket.AF_INET
    taken = socket.socket(family, socket.SOCK_STREAM)
    taken.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        taken.bind((options.host, options.port))
        taken.listen(128)
    except OSError as error:
        taken.close()
        remedy = "another --port, or end what listens there"
        value = f"{options.host}:{options.port}"
        raise InputError(f"cannot listen: {error.strerror}", field="--port", value=value, remedy=remedy) from error
    return taken
