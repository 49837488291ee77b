"""Documents that scripts of the page fetch, and those that they send: files, commands to a flight, cancelled orders of a fleet. No GET changes anything."""

from __future__ import annotations

import asyncio
import time
from importlib import resources
from typing import TYPE_CHECKING, Annotated, Any
from urllib.parse import quote

import msgspec
from fastapi import Request, Response
from fastapi.responses import JSONResponse
from starlette.staticfiles import StaticFiles

from skyway.link.supervisor.command.request_file import Request as OrderRequest
from skyway.models.base.errors import InputError, SkywayError, one_line
from skyway.models.base.files import read_bytes
from skyway.web.folder import LOGS, MISSIONS, REPORTS, safe_name
from skyway.web.guard import browser
from skyway.web.pages import fleet_answer
from skyway.web.pages.fleet import LEDGERS
from skyway.web.preferences import Preferences

if TYPE_CHECKING:
    from collections.abc import Coroutine

    from fastapi import FastAPI

    from skyway.web.site import Site


TAKEN = (*MISSIONS, *LOGS, ".json", ".geojson", ".param", ".toml")
"""Endings of files that may be uploaded."""
ANSWER_S, ANSWER_EVERY_S = 30.0, 0.5
"""How long the answer of a dispatcher is waited for, and how often it is looked for."""
MAX_REPORT = 64 * 2**20
"""Bytes of a report of the folder."""


class Order(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A command from a browser to a flight. Its id is from the browser: repeated after a lost answer, it counts once."""

    flight: Annotated[str, msgspec.Meta(max_length=300)]
    id: Annotated[str, msgspec.Meta(pattern="^[0-9a-zA-Z-]{8,64}$")]
    word: Annotated[str, msgspec.Meta(min_length=1, max_length=100)]
    name: Annotated[str, msgspec.Meta(max_length=40)] = ""
    about: int | None = None

    def request(self, who: str) -> OrderRequest:
        """Return it in the form of the supervisor."""
        name = self.name.strip() or f"operator {who[:4]}"
        return OrderRequest(id=self.id, word=self.word, who=who, name=name, time_s=time.time(), about=self.about)


class Cancel(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A request from a browser to cancel an order of a fleet."""

    ledger: Annotated[str, msgspec.Meta(max_length=300)]
    holder: Annotated[str, msgspec.Meta(max_length=300)]
    order: Annotated[str, msgspec.Meta(min_length=1, max_length=300)]
    name: Annotated[str, msgspec.Meta(max_length=40)] = ""

    def by(self, who: str) -> str:
        """Return who asks, for the records of the fleet."""
        return one_line(self.name).strip() or f"operator {who[:4]}"


async def _waited_for(request: Request, work: Coroutine[Any, Any, Any]) -> Any:
    """Return a computed result; the computation is cancelled, with an error, if the browser disconnects."""
    working, gone = asyncio.ensure_future(work), asyncio.ensure_future(_gone(request))
    try:
        await asyncio.wait({working, gone}, return_when=asyncio.FIRST_COMPLETED)
        if not working.done():
            raise SkywayError("no question is open")
        return await working
    finally:
        for task in (working, gone):
            task.cancel()


async def _gone(request: Request) -> None:
    while (await request.receive())["type"] != "http.disconnect":
        pass


async def _answer(site: Site, name: str, *arguments: Any, ends_with: Request | None = None) -> Response:
    """Return a worker's result, or its error; heavy work ends when the browser disconnects."""
    asked = site.workers.ask(name, *arguments)
    try:
        found = await (asked if ends_with is None else _waited_for(ends_with, asked))
    except SkywayError as error:
        return JSONResponse({"error": str(error)}, 422)
    return JSONResponse(found, headers={"cache-control": "no-store"})


def add(app: FastAPI, site: Site) -> None:
    """Add them to an application."""
    app.mount("/static", StaticFiles(directory=str(resources.files("skyway.web") / "static")))
    _logs(app, site)
    _base_maps(app, site)
    _fleets(app, site)

    @app.get("/api/region")
    async def region(request: Request) -> Response:
        wanted = Preferences.of(request.cookies)
        try:
            told = await site.region()
            zones = [one | {"limits": wanted.in_words(one["limits"])} for one in told["zones"]]
            return JSONResponse(told | {"zones": zones}, headers={"cache-control": "no-store"})
        except SkywayError as error:
            return JSONResponse({"error": str(error)}, 422)

    @app.get("/api/wind")
    async def wind(request: Request) -> Response:
        return await _answer(site, "region.winds", site.scenario, _conditions(request))

    @app.get("/api/ground")
    async def ground() -> Response:
        return await _answer(site, "region.ground", site.scenario)

    @app.get("/api/queues")
    async def queues(request: Request) -> Response:
        return await _answer(site, "region.queues", site.scenario, _conditions(request))

    @app.get("/api/fleet")
    async def fleet() -> Response:
        return Response(
            await site.fleet.document(), media_type="application/json", headers={"cache-control": "no-store"}
        )

    @app.get("/api/positions")
    async def positions(request: Request) -> Response:
        since = request.query_params.get("since", "0")
        told = await site.fleet.positions(int(since) if since.isdecimal() and len(since) < 16 else 0)
        return Response(msgspec.json.encode(told), media_type="application/json", headers={"cache-control": "no-store"})

    @app.get("/api/flight")
    async def flight(request: Request) -> Response:
        name, seen = request.query_params.get("name", "")[:300], request.query_params.get("seen", "0")
        try:
            told = site.flights.told(
                name, int(seen) if seen.isdecimal() and len(seen) < 12 else 0, browser(request.headers)
            )
        except SkywayError as error:
            return JSONResponse({"error": str(error)}, 404)
        return JSONResponse(told, headers={"cache-control": "no-store"})

    @app.post("/api/order")
    async def order(request: Request) -> Response:
        who = browser(request.headers)
        if not who:
            return JSONResponse({"error": "this browser has no session: open the page first"}, 403)
        try:
            asked = msgspec.json.decode(await request.body(), type=Order)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            return JSONResponse({"error": f"is not an order: {error}"}, 422)
        try:
            site.flights.order(asked.flight, asked.request(who))
        except SkywayError as error:
            return JSONResponse({"error": str(error)}, 409)
        return JSONResponse({"id": asked.id})

    @app.post("/api/upload")
    async def upload(request: Request) -> Response:
        name = safe_name(request.query_params.get("name", "")[:300])
        if not name.lower().endswith(TAKEN):
            return JSONResponse({"error": f"not a file that the page reads: {', '.join(TAKEN)}"}, 415)
        try:
            content = await request.body()
            kept = site.folder.free_name(name)
            site.folder.write(kept, content)
        except SkywayError as error:
            return JSONResponse({"error": str(error)}, 422)
        return JSONResponse({"name": kept})


def _fleets(app: FastAPI, site: Site) -> None:
    """Add the status of fleets, and the cancellation of their orders."""

    @app.get("/api/dispatch")
    async def dispatched(request: Request) -> Response:
        name, holder = (request.query_params.get(one, "")[:300] for one in ("ledger", "holder"))
        try:
            found = await site.workers.ask("dispatched.told", _ledger(site, name), holder)
        except SkywayError as error:
            return JSONResponse({"error": str(error)}, 422)
        vehicles = [
            {"id": one["id"], "name": one["id"], "lat": one["lat"], "lon": one["lon"], "stale": one["state"] == "lost"}
            for one in found["drones"]
            if one["lat"] is not None
        ]
        wanted = Preferences.of(request.cookies)
        shown = {"parts": fleet_answer.parts(found, wanted), "cancellable": fleet_answer.cancellable(found, wanted)}
        return JSONResponse(shown | {"vehicles": vehicles}, headers={"cache-control": "no-store"})

    @app.post("/api/dispatch/cancel")
    async def cancelled(request: Request) -> Response:
        """Ask for the cancellation of an order, and wait for some time for the answer of the dispatcher."""
        who = browser(request.headers)
        if not who:
            return JSONResponse({"error": "this browser has no session: open the page first"}, 403)
        try:
            asked = msgspec.json.decode(await request.body(), type=Cancel)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            return JSONResponse({"error": f"is not a cancellation: {error}"}, 422)
        until_s = time.monotonic() + ANSWER_S
        try:
            where = _ledger(site, asked.ledger), asked.holder, asked.order
            answer = await site.workers.ask("dispatched.cancel", *where, asked.by(who))
            while answer["waits"] and time.monotonic() < until_s:
                await asyncio.sleep(ANSWER_EVERY_S)
                answer = await site.workers.ask("dispatched.cancellation", *where)
        except SkywayError as error:
            return JSONResponse({"error": str(error)}, 409)
        return JSONResponse(answer)


def _ledger(site: Site, name: str) -> str:
    """Return the path of a ledger of the work folder."""
    if not name.lower().endswith(LEDGERS):
        raise InputError("is not a ledger of the work folder", field="--ledger", value=name)
    return str(site.folder.existing(name))


def _logs(app: FastAPI, site: Site) -> None:
    """Add logs for replay, and reports of journals."""

    @app.get("/api/replay")
    async def replay(request: Request) -> Response:
        try:
            path = site.folder.existing(request.query_params.get("log", ""))
        except SkywayError as error:
            return JSONResponse({"error": str(error)}, 404)
        return await _answer(site, "replayed.shown", str(path), ends_with=request)

    @app.get("/api/report")
    async def report(request: Request) -> Response:
        """A report to save, made from a journal or from the folder: it is never shown as a page of ours."""
        kept = request.query_params.get("file", "")
        try:
            if kept and not kept.lower().endswith(REPORTS):
                raise InputError("is not a report of the work folder", field="file", value=kept[:200])
            path = site.folder.existing(kept or request.query_params.get("journal", ""))
        except SkywayError as error:
            return JSONResponse({"error": str(error)}, 404)
        try:
            if kept:
                content = await asyncio.to_thread(read_bytes, path, max_bytes=MAX_REPORT)
            else:
                content = await _waited_for(request, site.workers.ask("history.report", str(path), site.scenario))
        except SkywayError as error:
            return JSONResponse({"error": str(error)}, 422)
        headers = {
            "content-disposition": f"attachment; filename*=UTF-8''{quote(safe_name(f'{path.stem}.html'))}",
            "cache-control": "no-store",
        }
        return Response(content, media_type="application/octet-stream", headers=headers)


def _base_maps(app: FastAPI, site: Site) -> None:
    """Add the layers beneath the network."""

    @app.get("/api/base")
    async def base() -> Response:
        return JSONResponse(site.options.base.about())

    @app.get("/api/tile")
    def tile(z: int, x: int, y: int) -> Response:
        found = site.options.base.tile(z, x, y)
        if found is None:
            return Response(status_code=204)
        headers = {"cache-control": "max-age=3600"} | ({"content-encoding": found.encoding} if found.encoding else {})
        return Response(found.content, media_type=found.media_type, headers=headers)

    @app.get("/api/outline")
    async def outline() -> Response:
        given = site.options.outline
        return JSONResponse({"shapes": []}) if given is None else await _answer(site, "outline.shapes", str(given))


def _conditions(request: Request) -> dict[str, Any]:
    return {name: request.query_params.get(name, "")[:100] or None for name in ("depart", "wind")}
