"""The page as an ASGI application: NiceGUI, our files, and documents for scripts of the page."""

from __future__ import annotations

import asyncio
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING, Any

from fastapi import FastAPI
from nicegui import app as pages
from nicegui import ui
from starlette.requests import ClientDisconnect
from starlette.responses import PlainTextResponse

from skyway.web.live import demonstration
from skyway.web.server import RECONNECT_S

if TYPE_CHECKING:
    from collections.abc import AsyncIterator

    from starlette.requests import Request
    from starlette.responses import Response

    from skyway.web.site import Site


def application(site: Site) -> Any:
    """Return the application; one for each process."""
    from skyway.web import documents
    from skyway.web.pages import fleet, fly, history, missions, plan, replay
    from skyway.web.pages.recharge import page as recharge

    @asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncIterator[None]:
        demo = asyncio.create_task(demonstration.begin_once(site)) if site.options.demo else None
        yield
        if demo is not None:
            demo.cancel()
        site.stop()

    outer = FastAPI(lifespan=lifespan, docs_url=None, redoc_url=None, openapi_url=None)
    outer.add_exception_handler(ClientDisconnect, _cut_off)
    documents.add(outer, site)
    for page in (plan, missions, recharge, fly, fleet, replay, history):
        page.add(site)
    pages.config.socket_io_js_transports = ["websocket"]
    pages.config.endpoint_documentation = "none"
    ui.run_with(
        outer, title="skyway", tailwind=False, dark=None, language="en-US", reconnect_timeout=RECONNECT_S,
        message_history_length=200, binding_refresh_interval=None, show_welcome_message=False, gzip_middleware_factory=None,
    )  # fmt: skip
    return outer


async def _cut_off(_: Request, __: Exception) -> Response:
    """Answer a request that `Guard` has rejected, or whose sender has disconnected."""
    return PlainTextResponse("skyway: the request was too large, or too slow\n", 413)
