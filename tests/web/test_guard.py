"""Who may ask, from where, and how much; what browsers may load. The application behind the guard is a stub."""

from __future__ import annotations

import asyncio

import pytest

from skyway.web.guard import COOKIE, TRYING, Guard

HOME = "127.0.0.1:8080"
TOKEN = "a-long-enough-token"


async def _app(scope, receive, send):
    size = 0
    while scope["type"] == "http" and (message := await receive())["type"] == "http.request":
        size += len(message.get("body", b""))
        if not message.get("more_body"):
            break
    kind = b"text/html; charset=utf-8" if scope["path"] == "/" else b"application/json"
    if scope["type"] == "websocket":
        await send({"type": "websocket.accept"})
        return
    await send({"type": "http.response.start", "status": 200, "headers": [(b"content-type", kind)]})
    await send({"type": "http.response.body", "body": b"<script>1</script>%d" % size})


def _asked(method="GET", path="/", token=None, kind="http", body=(b"",), guard=None, twice=(), **headers):
    headers = {"host": HOME} | {name.replace("_", "-"): value for name, value in headers.items()}
    scope = {
        "type": kind,
        "method": method,
        "path": path,
        "headers": [(n.encode(), v.encode("latin-1")) for n, v in (*headers.items(), *twice)],
    }
    pieces, sent = list(body), []

    async def receive():
        return {"type": "http.request", "body": pieces.pop(0), "more_body": bool(pieces)}

    async def send(message):
        sent.append(message)

    asyncio.run((guard or Guard(_app, token))(scope, receive, send))
    first = sent[0]
    if kind == "websocket":
        return first["type"], {}, b""
    return first["status"], dict(first["headers"]), b"".join(one.get("body", b"") for one in sent[1:])


@pytest.mark.parametrize(
    ("status", "asked"),
    [
        (200, {}),
        (200, {"host": "localhost:1"}),
        (200, {"host": "[::1]:8080"}),
        (403, {"host": "evil.example"}),  # a foreign name that resolves to this machine
        (403, {"host": "127.0.0.1.evil.example:8080"}),
        (403, {"host": "[not-an-address"}),
        (403, {"host": ""}),
        (403, {"host": f"evil.example@{HOME}"}),
        (403, {"host": f"{HOME}#evil.example"}),
        (403, {"host": f"evil.example\\@{HOME}"}),
        (400, {"twice": [("host", "evil.example")]}),  # who stands between may judge the other one
        (400, {"host": "evil.example", "twice": [("host", HOME)]}),
        (400, {"method": "POST", "origin": "http://evil.example", "twice": [("origin", f"http://{HOME}")]}),
        (403, {"method": "POST"}),  # from a form elsewhere, or from no browser
        (403, {"method": "POST", "origin": "http://evil.example"}),
        (403, {"method": "POST", "origin": f"http://{HOME}.evil.example"}),
        (403, {"method": "DELETE", "origin": "null"}),
        (403, {"method": "POST", "origin": f"file://{HOME}"}),
        (403, {"method": "POST", "origin": f"http://evil.example@{HOME}"}),
        (403, {"method": "POST", "origin": f"http://{HOME}/#"}),
        (403, {"method": "POST", "origin": "http://[evil"}),
        (200, {"method": "POST", "origin": f"http://{HOME}"}),
        (403, {"sec_fetch_site": "cross-site", "sec_fetch_mode": "no-cors"}),
        (200, {"sec_fetch_site": "cross-site", "sec_fetch_mode": "navigate"}),
        (400, {"path": "/_nicegui_ws/socket.io/"}),  # polling would carry changes in GETs
        (413, {"content_length": str(2**40)}),
        (413, {"content_length": "-1"}),
        (413, {"content_length": "\xb2"}),
        (413, {"content_length": "9" * 5000}),
        (401, {"token": TOKEN}),
        (401, {"token": TOKEN, "cookie": f"{COOKIE}={TOKEN}"}),
        (303, {"token": TOKEN, "accept": "text/html"}),
        (200, {"token": TOKEN, "path": "/sign-in"}),
    ],
)
def test_only_browsers_on_the_page_itself_are_answered(status, asked):
    assert _asked(**asked)[0] == status


@pytest.mark.parametrize(
    ("answer", "headers"),
    [
        ("websocket.accept", {"origin": f"http://{HOME}"}),
        ("websocket.close", {"origin": "http://evil.example"}),
        ("websocket.close", {}),
        ("websocket.close", {"origin": f"http://{HOME}", "token": TOKEN}),
    ],
)
def test_a_websocket_is_opened_by_the_page_itself_alone(answer, headers):
    assert _asked(kind="websocket", **headers)[0] == answer


def test_a_body_without_a_length_is_cut_off_where_it_grows_too_long():
    guard = Guard(_app, max_body=100)
    asked = {"method": "POST", "origin": f"http://{HOME}", "path": "/x"}
    assert _asked(guard=guard, body=[b"a" * 50, b"b" * 50], **asked)[2].endswith(b"100")
    assert _asked(guard=guard, body=[b"a" * 60, b"b" * 60, b"c" * 60], **asked)[2].endswith(b"60")


def test_scripts_run_with_the_nonce_of_their_page_and_nothing_comes_from_another_host():
    _, headers, body = _asked()
    policy = headers[b"content-security-policy"].decode()
    nonce = policy.split("'nonce-", 1)[1].split("'", 1)[0]
    assert body.startswith(f'<script nonce="{nonce}">'.encode())
    assert int(headers[b"content-length"]) == len(body)
    assert nonce not in _asked()[1][b"content-security-policy"].decode()
    assert "http" not in policy
    assert "*" not in policy
    assert "'unsafe-inline'" not in policy.split("script-src", 1)[1].split(";", 1)[0]
    assert policy.startswith("default-src 'none'")


def test_the_token_is_taken_once_and_a_cookie_kept_that_no_other_site_sends():
    asked = {"method": "POST", "path": "/sign-in", "origin": f"http://{HOME}", "token": TOKEN}
    status, headers, _ = _asked(body=[b"token=" + TOKEN.encode()], **asked)
    cookie = headers[b"set-cookie"].decode()
    assert status == 303
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    assert TOKEN not in cookie
    kept = cookie.split(";", 1)[0]
    assert _asked(token=TOKEN, cookie=f"other=1; {kept}")[0] == 200
    assert _asked(token=TOKEN + "x", cookie=kept)[0] == 401


def test_a_wrong_token_is_refused_after_a_while(monkeypatch):
    monkeypatch.setattr("skyway.web.guard.WRONG_S", 0.0)
    asked = {"method": "POST", "path": "/sign-in", "origin": f"http://{HOME}", "token": TOKEN}
    status, headers, body = _asked(body=[b"token=%3Cscript%3E"], **asked)
    assert status == 403
    assert b"set-cookie" not in headers
    assert b"That is not the token" in body
    assert b"<script" not in body


def test_of_many_that_sign_in_at_once_no_more_are_waited_for():
    guard = Guard(_app, TOKEN)
    headers = [(b"host", HOME.encode()), (b"origin", f"http://{HOME}".encode())]
    scope = {"type": "http", "method": "POST", "path": "/sign-in", "headers": headers}

    async def run():
        async def nothing():
            await asyncio.Event().wait()

        async def send(message):
            sent.append(message)

        sent = []
        waiting = [asyncio.ensure_future(guard(scope, nothing, send)) for _ in range(TRYING)]
        await asyncio.sleep(0)
        await guard(scope, nothing, send)
        for one in waiting:
            one.cancel()
        await asyncio.gather(*waiting, return_exceptions=True)
        refused = sent[0]["status"]
        sent.clear()

        async def token():
            return {"type": "http.request", "body": b"token=" + TOKEN.encode()}

        await guard(scope, token, send)
        return refused, sent[0]["status"]

    assert asyncio.run(run()) == (503, 303)


def test_a_token_of_which_half_came_is_not_judged_so_that_others_need_not_wait(monkeypatch):
    monkeypatch.setattr("skyway.web.guard.WRONG_S", 60.0)
    headers = [(b"host", HOME.encode()), (b"origin", f"http://{HOME}".encode())]
    scope = {"type": "http", "method": "POST", "path": "/sign-in", "headers": headers}
    pieces = [{"type": "http.request", "body": b"token=a", "more_body": True}, {"type": "http.disconnect"}]
    sent = []

    async def receive():
        return pieces.pop(0)

    async def send(message):
        sent.append(message)

    asyncio.run(asyncio.wait_for(Guard(_app, TOKEN)(scope, receive, send), 5.0))
    assert sent[0]["status"] == 403
