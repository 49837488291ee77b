"""Documents that scripts of the page fetch: GET only, nothing is changed by any of them."""

from __future__ import annotations

from importlib import resources
from typing import TYPE_CHECKING, Any

from fastapi import Request, Response  # noqa: TC002  FastAPI reads annotations at run time
from fastapi.responses import JSONResponse
from starlette.staticfiles import StaticFiles

from skyway.models.base.errors import SkywayError
from skyway.web.folder import LOGS, MISSIONS, safe_name

if TYPE_CHECKING:
    from fastapi import FastAPI

    from skyway.web.site import Site


TAKEN = (*MISSIONS, *LOGS, ".json", ".geojson", ".param", ".toml")
"""Endings of files that may be uploaded."""


def add(app: FastAPI, site: Site) -> None:
    """Add them to an application."""
    app.mount("/static", StaticFiles(directory=str(resources.files("skyway.web") / "static")))

    async def answer(name: str, *arguments: Any) -> Response:
        try:
            found = await site.workers.ask(name, *arguments)
        except SkywayError as error:
            return JSONResponse({"error": str(error)}, 422)
        return JSONResponse(found, headers={"cache-control": "no-store"})

    @app.get("/api/region")
    async def region() -> Response:
        return await answer("region.region", site.scenario)

    @app.get("/api/wind")
    async def wind(request: Request) -> Response:
        return await answer("region.winds", site.scenario, _conditions(request))

    @app.get("/api/queues")
    async def queues(request: Request) -> Response:
        return await answer("region.queues", site.scenario, _conditions(request))

    @app.get("/api/replay")
    async def replay(request: Request) -> Response:
        try:
            path = site.folder.existing(request.query_params.get("log", ""))
        except SkywayError as error:
            return JSONResponse({"error": str(error)}, 404)
        return await answer("replayed.shown", str(path))

    @app.get("/api/fleet")
    async def fleet() -> Response:
        return JSONResponse(await site.fleet.digest(), headers={"cache-control": "no-store"})

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

    @app.get("/api/outline")
    async def outline() -> Response:
        given = site.options.outline
        return await answer("outline.shapes", None if given is None else str(given))


def _conditions(request: Request) -> dict[str, Any]:
    return {name: request.query_params.get(name, "")[:100] or None for name in ("depart", "wind")}
