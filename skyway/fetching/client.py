"""An HTTP client for weather services: retries, time limits, bounds, byte ranges, and a cache of immutable data."""

from __future__ import annotations

import hashlib
import os
import time
import urllib.error
import urllib.request
from dataclasses import dataclass
from email.utils import parsedate_to_datetime
from http.client import HTTPException
from pathlib import Path
from typing import TYPE_CHECKING

from skyway import __version__
from skyway.models.base.errors import InputError, LinkError
from skyway.models.base.files import write_atomically

if TYPE_CHECKING:
    from collections.abc import Callable

TIMEOUT_S = 30.0
TRIES = 5
FIRST_WAIT_S = 1.0
MAX_WAIT_S = 60.0
MAX_BYTES = 400_000_000
AGAIN = (408, 425, 429, 500, 502, 503, 504)
"""Answers that another try may better."""


class NotThereError(LinkError):
    """The service has no such file, or not yet."""


def cache_folder() -> Path:
    """Cache folder for byte ranges of files that never change."""
    base = os.environ.get("XDG_CACHE_HOME") or str(Path("~/.cache").expanduser())
    return Path(base) / "skyway" / "weather"


@dataclass
class Client:
    """Client that counts its requests.

    Attributes
    ----------
    cache : Path or None
        Folder of what was fetched before; None: nothing is kept.
    sleep : callable
        Waits so many seconds between tries.
    """

    cache: Path | None = None
    sleep: Callable[[float], None] = time.sleep
    requests: int = 0
    received: int = 0
    cached: int = 0

    def get(self, url: str, *, begin: int | None = None, end: int | None = None, keeps: bool = False) -> bytes:
        """Fetch a URL, or its bytes from `begin` to `end` (the last one included; None: to the end of the file).

        What `keeps` never changes at the service, and is looked for in the cache first. Raises a `NotThereError` if the service does not have it, a `LinkError` with the reason
        it failed.
        """
        span = "" if begin is None else f"bytes={begin}-{'' if end is None else end}"
        kept = self._kept(url, span) if keeps else None
        if kept is not None and kept.is_file():
            self.cached += 1
            return kept.read_bytes()
        data = self._tried(url, span, None if begin is None or end is None else end - begin + 1)
        if kept is not None:
            kept.parent.mkdir(parents=True, exist_ok=True)
            write_atomically(kept, data, force=True)
        return data

    def _kept(self, url: str, span: str) -> Path | None:
        if self.cache is None:
            return None
        return self.cache / hashlib.sha256(f"{url} {span}".encode()).hexdigest()

    def _tried(self, url: str, span: str, length: int | None) -> bytes:
        if not url.startswith(("https://", "http://")):
            raise InputError("not a web address", field="--server", value=url, remedy="https://…")
        wait_s, last = FIRST_WAIT_S, ""
        for number in range(TRIES):
            if number:
                self.sleep(wait_s)
                wait_s = min(2.0 * wait_s, MAX_WAIT_S)
            try:
                data = self._once(url, span)
            except urllib.error.HTTPError as error:
                with error:
                    last = f"HTTP {error.code} {error.reason}"
                    if error.code == 404:
                        raise NotThereError(f"{url}: the service does not have it") from None
                    if error.code not in AGAIN:
                        detail = error.read(300).decode("utf-8", "replace").strip()
                        raise LinkError(f"{url}: {last}{': ' + detail if detail else ''}") from None
                    wait_s = max(wait_s, _wanted_wait_s(error.headers.get("Retry-After")))
            except (OSError, HTTPException) as error:
                last = str(getattr(error, "reason", None) or error) or type(error).__name__
            else:
                if length is None or len(data) == length:
                    return data
                last = f"{len(data)} bytes of {length} came"
        raise LinkError(f"{url}: failed {TRIES} times: {last}")

    def _once(self, url: str, span: str) -> bytes:
        headers = {"User-Agent": f"skyway/{__version__}", "Accept-Encoding": "identity"}
        if span:
            headers["Range"] = span
        self.requests += 1
        with urllib.request.urlopen(urllib.request.Request(url, headers=headers), timeout=TIMEOUT_S) as answer:  # noqa: S310  see _tried
            if span and answer.status != 206:
                raise LinkError(f"{url}: the service does not give parts of files (HTTP {answer.status})")
            told = answer.headers.get("Content-Length")
            data: bytes = answer.read(MAX_BYTES + 1)
        if len(data) > MAX_BYTES:
            raise LinkError(f"{url}: the answer is larger than {MAX_BYTES / 1e6:.0f} MB")
        if told is not None and told.isdigit() and len(data) < int(told):
            raise OSError(f"{len(data)} bytes of {told} came")
        self.received += len(data)
        return data


def _wanted_wait_s(text: str | None) -> float:
    """Seconds of a Retry-After header; 0 where it says nothing."""
    if text is None:
        return 0.0
    try:
        wait_s = float(text)
    except ValueError:
        try:
            wait_s = parsedate_to_datetime(text).timestamp() - time.time()
        except (TypeError, ValueError):
            return 0.0
    return min(max(wait_s, 0.0), MAX_WAIT_S)
