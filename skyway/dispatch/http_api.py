"""The HTTP API of a service: takes orders and reports the status; described by OpenAPI at ``/openapi.json``.

It only reads and writes the desk, so it agrees with the ledger, and answers while the dispatcher plans.
"""

from __future__ import annotations

import hmac
import json
import os
import threading
from typing import TYPE_CHECKING, Annotated, Any

from fastapi import Depends, FastAPI, HTTPException, Request, Response
from fastapi.responses import JSONResponse, PlainTextResponse
from pydantic import BaseModel, ConfigDict, Field
from starlette.exceptions import HTTPException as StarletteHTTPException

from skyway.dispatch.requests import (
    LEDGER_WAIT_S,
    NotCancelledError,
    cancel_order,
    cancellation,
    give_orders,
    unknown_order,
)
from skyway.dispatch.status import document_of, order_document, prometheus, status_of
from skyway.models.base.errors import InputError, SkywayError
from skyway.models.ledger.desk import Desk
from skyway.models.ledger.ledger import LedgerError
from skyway.models.ledger.opening import open_ledger
from skyway.models.orders.files import order_of
from skyway.models.orders.order import Order  # noqa: TC001  FastAPI reads the annotation

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable

TOKEN = "SKYWAY_TOKEN"  # noqa: S105  the name of a variable
LOOPBACK = frozenset({"127.0.0.1", "localhost", "::1"})
MAX_BODY = 100_000
WALL_S = 10.0
SCHEMAS = "#/components/schemas/{model}"


class NewOrder(BaseModel):
    """An order; the fields are those of orders.csv, whose reader reads it (`models.orders.files`)."""

    model_config = ConfigDict(extra="forbid")
    id: str = Field(description="Unique: the same id is refused the second time. Without /, and not . or ..")
    origin: str = Field(alias="from", description="Station id, part of its name, or lat,lon.")
    to: str = Field(description="Station id, part of its name, or lat,lon.")
    mass_kg: float = Field(description="Mass of the package, kg.")
    ready: str = Field(description="Earliest pick-up; ISO 8601 with UTC offset.")
    due: str = Field(description="Due time of the delivery; ISO 8601 with UTC offset.")
    kind: str = ""
    priority: int = 0
    value: float | None = None


class OrderStatus(BaseModel):
    """State of an order."""

    id: str
    state: str = Field(
        description="new, promised, under way, aboard, delivered, refused, cancelled, or handed to a person."
    )
    origin: str = Field(alias="from")
    to: str
    mass_kg: float
    kind: str
    priority: int
    ready: str
    due: str
    drone: str | None
    promised: str | None = Field(description="Promised delivery time.")
    chance: float | None = Field(description="Probability of delivery by the due time, from simulations of the plan.")
    p50: str | None = Field(description="Median of the delivery time.")
    p95: str | None = Field(description="95 % quantile of the delivery time.")
    first_promised: str | None
    changes: int = Field(description="Number of changes of the promise.")
    delivered: str | None
    cancelled: str | None = Field(description="Time of the cancellation.")
    cancelled_by: str | None = Field(description="Who asked for the cancellation.")
    place: str = Field(description="Place of the package, or of its pick-up.")
    reason: str = Field(description="Reason for a refusal, a cancellation, a wait, or a hand-over to a person.")


class Problem(BaseModel):
    """Reason for the refusal of a request: one line for each fault."""

    problems: list[str]


def application(ledger: str, dispatcher: str, *, token: str | None = None) -> FastAPI:
    """Return the API of a dispatcher as an ASGI application; with a token, requests must carry it (``Authorization: Bearer …``)."""
    api = FastAPI(title="skyway dispatch", version="1", description=__doc__ or "", docs_url=None, redoc_url=None)
    refused: dict[int | str, dict[str, Any]] = {422: {"model": Problem}, 404: {"model": Problem}}

    def desk() -> Desk:
        return Desk(open_ledger(ledger, create=False, wait_s=LEDGER_WAIT_S), dispatcher)

    @api.middleware("http")
    async def guarded(request: Request, call_next: Callable[[Request], Awaitable[Response]]) -> Response:
        host = request.headers.get("host", "").rpartition(":")[0] or request.headers.get("host", "")
        if token is None and host.strip("[]") not in LOOPBACK:
            return JSONResponse({"problems": ["the request names another host"]}, 403)
        if token is not None:
            given = request.headers.get("authorization", "").removeprefix("Bearer ")
            if not hmac.compare_digest(given.encode(), token.encode()):
                return JSONResponse({"problems": ["a token is needed: Authorization: Bearer …"]}, 401)
        return await call_next(request)

    @api.exception_handler(SkywayError)
    async def faulty(_: Request, error: Exception) -> Response:
        status = 422 if isinstance(error, InputError) else 503 if isinstance(error, LedgerError) else 500
        return JSONResponse({"problems": str(error).splitlines()}, status)

    @api.exception_handler(StarletteHTTPException)
    async def unanswered(_: Request, error: Exception) -> Response:
        if not isinstance(error, StarletteHTTPException):
            raise error
        return JSONResponse({"problems": [str(error.detail)]}, error.status_code, error.headers)

    @api.exception_handler(Exception)
    async def broken(_: Request, error: Exception) -> Response:
        return JSONResponse({"problems": [f"internal error: {type(error).__name__}, see the log of the service"]}, 500)

    sent = {"required": True, "content": {"application/json": {"schema": {"$ref": SCHEMAS.format(model="NewOrder")}}}}

    @api.post(
        "/orders", status_code=201, response_model=OrderStatus, responses=refused, openapi_extra={"requestBody": sent}
    )
    def add_order(order: Annotated[Order, Depends(_sent)]) -> dict[str, Any]:
        """Take an order; it is on the desk when the answer is sent."""
        place = desk()
        with place.ledger:
            give_orders(place, [order])
            return _order_status(place, order.id)

    @api.get("/orders", response_model=list[OrderStatus])
    def list_orders() -> list[dict[str, Any]]:
        """Return all orders."""
        place = desk()
        with place.ledger:
            return [order_document(name, state, one) for name, (state, one) in status_of(place).orders.items()]

    @api.get("/orders/{order_id}", response_model=OrderStatus, responses=refused)
    def get_order(order_id: str) -> dict[str, Any]:
        """Return one order."""
        place = desk()
        with place.ledger:
            if place.get("order", order_id) is None:
                raise HTTPException(404, str(unknown_order(place, order_id)))
            return _order_status(place, order_id)

    @api.post(
        "/orders/{order_id}/cancel",
        status_code=202,
        response_model=OrderStatus,
        responses={**refused, 200: {"model": OrderStatus}, 409: {"model": Problem}},
    )
    def cancel(order_id: str, response: Response) -> dict[str, Any]:
        """Ask the dispatcher to cancel an order: 202, its next step decides; 200 if it is cancelled; 409 if it cannot be cancelled."""
        place = desk()
        with place.ledger:
            response.status_code = _cancel(place, order_id)
            return _order_status(place, order_id)

    @api.get("/status")
    def status() -> dict[str, Any]:
        """Return the status of the service (``skyway.fleet-status/1``)."""
        place = desk()
        with place.ledger:
            return document_of(status_of(place))

    @api.get("/metrics", response_class=PlainTextResponse)
    def metrics() -> str:
        """Return figures in the text format of Prometheus."""
        place = desk()
        with place.ledger:
            return prometheus(status_of(place))

    described = api.openapi

    def with_the_order() -> dict[str, Any]:
        document = described()
        document["components"]["schemas"]["NewOrder"] = NewOrder.model_json_schema(ref_template=SCHEMAS)
        return document

    api.openapi = with_the_order  # type: ignore[method-assign]
    return api


async def _sent(request: Request) -> Order:
    """Read the order that a request sends."""
    if request.headers.get("content-type", "").partition(";")[0].strip().lower() != "application/json":
        raise HTTPException(415, "send application/json")
    body = bytearray()
    async for part in request.stream():
        body += part
        if len(body) > MAX_BODY:
            raise HTTPException(413, f"more than {MAX_BODY:,} bytes")
    try:
        values = json.loads(body.decode())
    except (ValueError, RecursionError) as error:
        problem = {UnicodeDecodeError: "is not UTF-8", RecursionError: "is nested too deeply"}.get(type(error))
        raise InputError(problem or f"is not JSON: {getattr(error, 'msg', 'a number too long')}", "order") from None
    if not isinstance(values, dict):
        raise InputError("must be an object", "order", value=json.dumps(values), remedy='{"id": …, "from": …, …}')
    return order_of(values, "order")


def _order_status(desk: Desk, order: str) -> dict[str, Any]:
    from skyway.dispatch.records import OrderRecord, read

    entry = desk.get("order", order)
    if entry is None:
        raise InputError("there is no such order", field="id", value=order)
    return order_document(entry.id, entry.state, read(entry, OrderRecord))


def _cancel(desk: Desk, order: str) -> int:
    """Ask for the cancellation of an order; return the status of the answer."""
    if desk.get("order", order) is None:
        raise HTTPException(404, str(unknown_order(desk, order)))
    try:
        asked = cancel_order(desk, order, "HTTP API") == "asked" and cancellation(desk, order) == "asked"
    except NotCancelledError as error:
        raise HTTPException(409, str(error)) from None
    return 202 if asked else 200


def serve_in_background(ledger: str, dispatcher: str, where: str) -> str:
    """Serve the API at ``HOST:PORT`` in a separate thread; return its address. A token is required unless only this machine has access."""
    import uvicorn

    host, _, port = where.rpartition(":")
    if not host or not port.isdigit() or int(port) > 65535:
        raise InputError("is not an address", field="--http", value=where, remedy="HOST:PORT, such as 127.0.0.1:8090")
    token = os.environ.get(TOKEN) or None
    if token is None and host.strip("[]") not in LOOPBACK:
        raise InputError(
            "anyone on the network could send orders",
            field="--http",
            value=where,
            remedy=f"set {TOKEN}, or listen at 127.0.0.1",
        )
    config = uvicorn.Config(
        application(ledger, dispatcher, token=token), host=host.strip("[]"), port=int(port), log_level="warning"
    )
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run, daemon=True, name="http")
    thread.start()
    end = threading.Event()
    waited = 0.0
    while not server.started and thread.is_alive() and waited < WALL_S:
        end.wait(0.05)
        waited += 0.05
    if not server.started:
        raise InputError("cannot be listened at", field="--http", value=where, remedy="another port")
    bound = server.servers[0].sockets[0].getsockname()
    return f"http://{host}:{bound[1]}"
