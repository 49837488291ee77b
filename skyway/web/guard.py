"""Protection of the page from the network: permitted senders, origins, sizes, and resources that browsers may load.

An ASGI application around another. Its own answers are only rejections and the sign-in.
"""

from __future__ import annotations

import asyncio
import hashlib
import hmac
import html
import re
import secrets
import time
from dataclasses import dataclass, field
from http.cookies import CookieError, SimpleCookie
from importlib import resources
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qs

from skyway.web.tiles.base import BaseMap
from skyway.web.tiles.content import PICTURES, VECTORS

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Mapping, MutableMapping

    Message = MutableMapping[str, Any]
    Receive = Callable[[], Awaitable[Message]]
    Send = Callable[[Message], Awaitable[None]]
    App = Callable[[MutableMapping[str, Any], Receive, Send], Awaitable[None]]

MAX_BODY = 64 * 2**20
"""Bytes of one request: a flight log of an hour, with room to spare."""
BODY_S = 120.0
"""A browser that takes longer to send a request is disconnected."""
COOKIE = "skyway_session"
BROWSER = "skyway_browser"
"""Cookie that identifies a browser: only one browser commands a flight."""
SIGN_IN = "/sign-in"
WRONG_S = 1.0
"""Delay of the answer to a wrong token, one at a time: this prevents guessing."""
LOOPBACK = frozenset({"127.0.0.1", "localhost", "::1"})
SAFE_METHODS = frozenset({"GET", "HEAD", "OPTIONS"})
ONCE = (b"host", b"origin", b"content-length")
"""Headers that are checked: of a duplicate, another program could check the other one."""
TRYING = 32
"""Limit of tokens that wait to be checked; more are not read."""
_HOST = re.compile(r"(?a:([\w.-]+)|\[([\da-fA-F:.]+)\])(?::\d{1,5})?")
_POLICY = (
    "default-src 'none'; script-src 'self' 'nonce-{nonce}' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:{pictures}; font-src 'self'; connect-src 'self'{vectors}; form-action 'self'; base-uri 'none'; "
    "frame-ancestors 'none'; object-src 'none'"
)
"""Nothing from another host, except for a tile server named by the operator. NiceGUI's Vue compiles templates in the browser, hence 'unsafe-eval'; a script in the page needs the nonce."""
_HEADERS = (
    (b"x-content-type-options", b"nosniff"),
    (b"x-frame-options", b"DENY"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"permissions-policy", b"camera=(), microphone=(), geolocation=(), usb=()"),
)


@dataclass(slots=True)
class Guard:
    """The guard of an application.

    Attributes
    ----------
    app : ASGI application
        The guarded application.
    token : str or None
        Password that a person types once in each browser; None admits every browser that may connect.
    max_body : int
        Bytes of one request.
    tiles : BaseMap
        The base map: if it is on another host, browsers may load its tiles from there.
    """

    app: App
    token: str | None = None
    max_body: int = MAX_BODY
    tiles: BaseMap = field(default_factory=BaseMap)
    _trying: asyncio.Lock = field(default_factory=asyncio.Lock)
    _signing: int = 0

    async def __call__(self, scope: MutableMapping[str, Any], receive: Receive, send: Send) -> None:
        """Let a request through, or refuse it."""
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
            return
        headers = {name.decode("latin-1"): value.decode("latin-1") for name, value in scope["headers"]}
        if (refused := self._refused(scope, headers)) is not None:
            await _refuse(scope, send, *refused)
        elif scope["path"] == SIGN_IN and scope["type"] == "http":
            await self._sign_in(scope, headers, receive, send)
        elif not self._known(headers):
            if scope["type"] == "http" and scope["method"] == "GET" and "text/html" in headers.get("accept", ""):
                await _see_other(send, SIGN_IN)
            else:
                await _refuse(scope, send, 401, "sign in first")
        elif scope["type"] == "websocket":
            await self.app(scope, receive, send)
        else:
            await self._pass(scope, receive, send)

    def _refused(self, scope: MutableMapping[str, Any], headers: dict[str, str]) -> tuple[int, str] | None:
        """Return status and reason of requests that no browser on our page would send."""
        names = [name for name, _ in scope["headers"]]
        if any(names.count(one) > 1 for one in ONCE):
            return 400, "a header is given twice"
        host = headers.get("host", "")
        name = _name(host)
        if not name or (self.token is None and name not in LOOPBACK):
            return 403, "this page answers at its own address only"  # a foreign name that points here
        changing = scope["type"] == "websocket" or scope["method"] not in SAFE_METHODS
        if changing and headers.get("origin", "").lower() not in {f"http://{host}".lower(), f"https://{host}".lower()}:
            return 403, "the request comes from another page"
        if headers.get("sec-fetch-site") == "cross-site" and headers.get("sec-fetch-mode") != "navigate":
            return 403, "the request comes from another page"
        if scope["type"] == "http" and scope["path"].startswith("/_nicegui_ws"):
            return 400, "this page speaks over a WebSocket"
        length = headers.get("content-length", "0")
        if not re.fullmatch(r"[0-9]{1,15}", length) or int(length) > self.max_body:
            return 413, f"more than {self.max_body // 2**20} MiB in one request"
        return None

    def _policy(self, nonce: str) -> str:
        """Return the resources that a browser may load."""
        host = "" if self.tiles.origin is None else f" {self.tiles.origin}"
        pictures, vectors = (host if self.tiles.kind == kind else "" for kind in (PICTURES, VECTORS))
        return _POLICY.format(nonce=nonce, pictures=pictures, vectors=vectors)

    def _known(self, headers: dict[str, str]) -> bool:
        if self.token is None:
            return True
        try:
            cookie = SimpleCookie(headers.get("cookie", "")).get(COOKIE)
        except CookieError:
            return False
        return cookie is not None and hmac.compare_digest(cookie.value.encode(), _session(self.token).encode())

    async def _sign_in(
        self, scope: MutableMapping[str, Any], headers: dict[str, str], receive: Receive, send: Send
    ) -> None:
        """Request the token, or check it."""
        if self.token is None:
            await _see_other(send, "/")
            return
        if scope["method"] in SAFE_METHODS:
            await _page(send, 200, "")
            return
        if self._signing >= TRYING:
            await _refuse(scope, send, 503, "many sign in now; try again")
            return
        self._signing += 1
        try:
            right = await self._right(self.token, receive)
        finally:
            self._signing -= 1
        if not right:
            await _page(send, 403, "That is not the token.")
            return
        secure = "; Secure" if scope.get("scheme") == "https" or headers.get("x-forwarded-proto") == "https" else ""
        cookie = f"{COOKIE}={_session(self.token)}; HttpOnly; SameSite=Strict; Path=/; Max-Age=2592000{secure}"
        await _see_other(send, "/", (b"set-cookie", cookie.encode()))

    async def _right(self, token: str, receive: Receive) -> bool:
        """Whether the token of a form is correct."""
        body = await _body(_bounded(receive, 4096, time.monotonic() + 10.0))
        if body is None:
            return False  # the sender has disconnected
        given = (parse_qs(body.decode("utf-8", "replace")).get("token") or [""])[0]
        async with self._trying:
            right = hmac.compare_digest(given.encode(), token.encode())
            if not right:
                await asyncio.sleep(WRONG_S)
        return right

    async def _pass(self, scope: MutableMapping[str, Any], receive: Receive, send: Send) -> None:
        """Pass a request on, its body bounded; the answer gets our headers, and its scripts a nonce.

        Pages are requested uncompressed, so that their scripts can be marked; no prefix of paths is taken from a request.
        """
        nonce = secrets.token_urlsafe(16)
        begun: Message = {}
        headers = {name.decode("latin-1"): value.decode("latin-1") for name, value in scope["headers"]}
        fresh = None if browser(headers) else secrets.token_urlsafe(24)
        pieces: list[bytes] = []

        async def answer(message: Message) -> None:
            if message["type"] == "http.response.start":
                kept = [(name, value) for name, value in message["headers"] if name.lower() != b"server"]
                kept += [*_HEADERS, (b"content-security-policy", self._policy(nonce).encode())]
                if fresh is not None and _is_html(kept):
                    cookie = f"{BROWSER}={fresh}; HttpOnly; SameSite=Strict; Path=/; Max-Age=31536000"
                    kept.append((b"set-cookie", cookie.encode()))
                begun.update(message, headers=kept)
                if not _is_html(kept):
                    await send(begun)
            elif not _is_html(begun.get("headers", ())):
                await send(message)
            else:
                pieces.append(message.get("body", b""))
                if not message.get("more_body"):
                    text = b"".join(pieces).replace(b"<script", b'<script nonce="' + nonce.encode() + b'"')
                    headers = [(name, value) for name, value in begun["headers"] if name.lower() != b"content-length"]
                    await send({**begun, "headers": [*headers, (b"content-length", str(len(text)).encode())]})
                    await send({"type": "http.response.body", "body": text})

        wants_page = any(name == b"accept" and b"text/html" in value for name, value in scope["headers"])
        dropped = {b"x-forwarded-prefix", b"accept-encoding"} if wants_page else {b"x-forwarded-prefix"}
        plain = {**scope, "headers": [pair for pair in scope["headers"] if pair[0] not in dropped]}
        await self.app(plain, _bounded(receive, self.max_body, time.monotonic() + BODY_S), answer)


def browser(headers: Mapping[str, str]) -> str:
    """Return a browser's pseudonym, for journals: it reveals nothing, and is empty if none was given."""
    try:
        found = SimpleCookie(headers.get("cookie", "")).get(BROWSER)
    except CookieError:
        return ""
    return hashlib.sha256(found.value.encode()).hexdigest()[:16] if found is not None and len(found.value) >= 16 else ""


def _name(host: str) -> str:
    """Name of a Host header without its port; empty if it is more than a name and a port."""
    found = _HOST.fullmatch(host)
    return (found[1] or found[2]).lower() if found else ""


def _is_html(headers: Any) -> bool:
    return any(name.lower() == b"content-type" and value.startswith(b"text/html") for name, value in headers)


def _session(token: str) -> str:
    """Cookie that replaces the token: the same after a restart."""
    return hmac.new(token.encode(), b"skyway session", hashlib.sha256).hexdigest()


def _bounded(receive: Receive, most: int, until: float) -> Receive:
    """Return a receiver with a limit of bytes and time; beyond it the browser counts as disconnected."""
    left, whole = most, False

    async def bounded() -> Message:
        nonlocal left, whole
        if whole or left < 0:
            return await receive() if whole else {"type": "http.disconnect"}
        try:
            message = await asyncio.wait_for(receive(), max(until - time.monotonic(), 0.01))
        except TimeoutError:
            left = -1
            return {"type": "http.disconnect"}
        left -= len(message.get("body", b""))
        whole = left >= 0 and not message.get("more_body")
        return message if left >= 0 else {"type": "http.disconnect"}

    return bounded


async def _body(receive: Receive) -> bytes | None:
    """Return the body of a request; None if its sender has disconnected."""
    pieces = []
    while (message := await receive())["type"] == "http.request":
        pieces.append(message.get("body", b""))
        if not message.get("more_body"):
            return b"".join(pieces)
    return None


async def _refuse(scope: MutableMapping[str, Any], send: Send, status: int, reason: str) -> None:
    if scope["type"] == "websocket":
        await send({"type": "websocket.close", "code": 4403, "reason": reason})
        return
    headers = [*_HEADERS, (b"content-type", b"text/plain; charset=utf-8"), (b"connection", b"close")]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": f"skyway: {reason}\n".encode()})


async def _see_other(send: Send, where: str, *more: tuple[bytes, bytes]) -> None:
    headers = [*_HEADERS, (b"location", where.encode()), (b"cache-control", b"no-store"), *more]
    await send({"type": "http.response.start", "status": 303, "headers": headers})
    await send({"type": "http.response.body", "body": b""})


async def _page(send: Send, status: int, fault: str) -> None:
    """Send the sign-in page."""
    text = (
        (resources.files("skyway.web") / "static" / "sign_in.html").read_text().replace("{{fault}}", html.escape(fault))
    )
    policy = (
        b"default-src 'none'; style-src 'unsafe-inline'; form-action 'self'; frame-ancestors 'none'; base-uri 'none'"
    )
    headers = [*_HEADERS, (b"content-type", b"text/html; charset=utf-8"), (b"content-security-policy", policy)]
    headers += [(b"cache-control", b"no-store")]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": text.encode()})
