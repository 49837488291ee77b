"""Clients that are slow, on purpose or not: cut off, whatever part of a request they are slow with; others are answered meanwhile."""

from __future__ import annotations

import asyncio
import contextlib

import pytest

from skyway.web import guard
from skyway.web.guard import Guard

uvicorn = pytest.importorskip("uvicorn", reason="needs the extra web")
HEAD = b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n"
POST = b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nOrigin: http://127.0.0.1\r\nContent-Length: 1000\r\n\r\n"
LARGE = 16 * 2**20


async def _app(scope, receive, send):
    """Read the whole body, then answer; a path named large with more than a connection takes at once."""
    if scope["type"] == "websocket":
        await receive()
        await send({"type": "websocket.accept"})
        await receive()
        return
    while (message := await receive())["type"] == "http.request":
        if not message.get("more_body"):
            answer = b"ok" if scope["path"] != "/large" else b"a" * LARGE
            length = str(len(answer)).encode()
            await send({"type": "http.response.start", "status": 200, "headers": [(b"content-length", length)]})
            await send({"type": "http.response.body", "body": answer})
            return


def against(talk):
    """Serve the stub behind the guard in this process, and talk to it."""
    from skyway.web.connections import Prompt

    async def run():
        config = uvicorn.Config(Guard(_app), http=Prompt, ws="websockets-sansio", log_level="critical", lifespan="off")
        config.load()
        server = uvicorn.Server(config)
        state = server.server_state
        async with contextlib.AsyncExitStack() as stack:
            make = lambda: Prompt(config=config, server_state=state, app_state={})  # noqa: E731
            listening = await asyncio.get_running_loop().create_server(make, "127.0.0.1", 0)
            stack.callback(listening.close)
            port = listening.sockets[0].getsockname()[1]

            async def opened():
                reader, writer = await asyncio.open_connection("127.0.0.1", port)
                stack.callback(writer.close)
                return reader, writer

            return await asyncio.wait_for(talk(opened), 20.0)

    return asyncio.run(run())


@pytest.fixture
def hurried(monkeypatch):
    monkeypatch.setattr("skyway.web.connections.REQUEST_S", 0.15)
    monkeypatch.setattr(guard, "BODY_S", 0.15)


@pytest.mark.parametrize("begun", [b"", b"G", HEAD, HEAD + b"X: " + b"a" * 500])
def test_who_does_not_finish_the_head_of_a_request_is_cut_off(hurried, begun):
    async def talk(opened):
        reader, writer = await opened()
        writer.write(begun)
        return await reader.read()

    assert against(talk) == b""


def test_a_head_that_comes_byte_by_byte_has_no_more_time(hurried):
    async def talk(opened):
        reader, writer = await opened()
        sent = 0
        with contextlib.suppress(ConnectionError):
            for byte in HEAD * 20:
                writer.write(bytes([byte]))
                await writer.drain()
                sent += 1
                if reader.at_eof():
                    break
                await asyncio.sleep(0.01)
        return sent

    assert against(talk) < 200


def test_the_second_request_of_a_connection_has_no_more_time_than_the_first(hurried):
    async def talk(opened):
        reader, writer = await opened()
        writer.write(HEAD + b"\r\n")
        first = await reader.readuntil(b"\r\n\r\nok")
        writer.write(HEAD)
        return first, await reader.read()

    first, rest = against(talk)
    assert first.startswith(b"HTTP/1.1 200")
    assert rest == b""


def test_a_body_that_does_not_come_ends_the_request_and_keeps_nobody_out(hurried):
    async def talk(opened):
        slow, writer = await opened()
        writer.write(POST)
        other, asking = await opened()
        asking.write(HEAD + b"\r\n")
        answered = await other.readuntil(b"\r\n\r\nok")
        return answered, await slow.read()

    answered, slow = against(talk)
    assert answered.startswith(b"HTTP/1.1 200")
    assert b"200" not in slow


def test_a_websocket_stays_open_though_it_says_nothing(hurried):
    key = b"Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\nOrigin: http://127.0.0.1\r\n\r\n"

    async def talk(opened):
        reader, writer = await opened()
        writer.write(HEAD + key)
        await reader.readuntil(b"\r\n\r\n")
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(reader.read(), 0.5)

    against(talk)


def test_a_head_that_does_not_end_is_not_kept_in_memory():
    async def talk(opened):
        reader, writer = await opened()
        sent = 0
        with contextlib.suppress(ConnectionError):
            writer.write(HEAD + b"X: ")
            while sent < LARGE:
                writer.write(b"a" * 2**16)
                await writer.drain()
                sent += 2**16
        with contextlib.suppress(ConnectionError):
            assert await reader.read() == b""
        return sent

    assert against(talk) < LARGE


@pytest.mark.parametrize("begun", [b"", HEAD, POST + b"a"])
def test_who_opens_many_connections_and_says_nothing_keeps_nobody_out(monkeypatch, begun):
    monkeypatch.setattr("skyway.web.connections.MOST_WAITED_FOR", 8)

    async def talk(opened):
        silent = [await opened() for _ in range(30)]
        for _, writer in silent:
            writer.write(begun)
        other, asking = await opened()
        asking.write(HEAD + b"\r\n")
        await other.readuntil(b"\r\n\r\nok")
        with contextlib.suppress(ConnectionError):
            assert await silent[0][0].read() == b""
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(silent[-1][0].read(), 0.05)

    against(talk)


def test_an_answer_that_nobody_takes_is_not_kept_for_them(monkeypatch):
    monkeypatch.setattr("skyway.web.connections.TAKEN_S", 0.05)

    async def talk(opened):
        reader, writer = await opened()
        writer.write(HEAD.replace(b"/ ", b"/large ", 1) + b"\r\n")
        await reader.readuntil(b"\r\n\r\n")
        writer.transport.pause_reading()
        await asyncio.sleep(0.25)
        writer.transport.resume_reading()
        taken = 0
        with contextlib.suppress(ConnectionError):
            while piece := await reader.read(2**20):
                taken += len(piece)
        return taken

    assert against(talk) < LARGE


def test_an_answer_that_is_taken_slowly_comes_whole(monkeypatch):
    monkeypatch.setattr("skyway.web.connections.TAKEN_S", 0.1)

    async def talk(opened):
        reader, writer = await opened()
        writer.write(HEAD.replace(b"/ ", b"/large ", 1) + b"\r\n")
        await reader.readuntil(b"\r\n\r\n")
        taken = 0
        while taken < LARGE:
            taken += len(await reader.read(2**20))
            await asyncio.sleep(0.005)
        return taken

    assert against(talk) == LARGE
