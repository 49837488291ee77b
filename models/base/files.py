"""Reading files within bounds, and writing them atomically; every failure is an `InputError`."""

from __future__ import annotations

import gzip
import os
import tempfile
import time
import zlib
from contextlib import contextmanager
from typing import TYPE_CHECKING, BinaryIO

from skyway.models.base.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


def file_error(action: str, path: Path, error: Exception) -> InputError:
    """Return the error of a file that the system does not allow to be ``read``, ``written`` or ``made`` (`action`)."""
    return InputError(f"cannot be {action}: {getattr(error, 'strerror', None) or error}", str(path))


def make_folder(folder: Path, field: str) -> None:
    """Make the folder of an option, with those above it; an `InputError` if the system does not allow it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        problem = f"the folder cannot be made: {error.strerror or error}"
        raise InputError(problem, str(folder), field=field, remedy="name a folder that can be written") from error


PIPE_S = 10.0
"""A named pipe that nothing opens for writing in so long is an error: reading it would never end."""


def _pipe_bytes(path: Path, max_bytes: int) -> bytes:
    """Read a pipe to its end, or beyond `max_bytes`; an `InputError` if nothing begins to write into it."""
    until, opened, data = time.monotonic() + PIPE_S, False, b""
    with os.fdopen(os.open(path, os.O_RDONLY | os.O_NONBLOCK), "rb", buffering=0) as stream:
        while len(data) <= max_bytes:
            part = stream.read(1 << 16)  # None: nothing yet; empty: nothing writes, not yet or no longer
            if part == b"" and opened:
                break
            if part == b"" and time.monotonic() > until:
                remedy = "start what writes into it, or name a file"
                raise InputError(f"is a pipe into which nothing writes within {PIPE_S:g} s", str(path), remedy=remedy)
            opened = opened or part != b""
            data += part or b""
            if not part:
                time.sleep(0.02)
    return data


def read_bytes(path: Path, *, max_bytes: int) -> bytes:
    """Read a file of at most `max_bytes` (counted after decompression for ``.gz``).

    Raises an `InputError` if it is missing, a folder, unreadable, damaged, too large, or a pipe into which nothing writes.
    """
    try:
        if path.is_fifo():
            data = _pipe_bytes(path, max_bytes)
        else:
            opener = gzip.open if path.suffix == ".gz" else open
            with opener(path, "rb") as stream:
                data = stream.read(max_bytes + 1)
    except FileNotFoundError:
        raise InputError("no such file", str(path)) from None
    except IsADirectoryError:
        raise InputError("is a folder, not a file", str(path)) from None
    except InputError:
        raise
    except (OSError, EOFError, zlib.error, ValueError) as error:
        raise file_error("read", path, error) from error
    if len(data) > max_bytes:
        remedy = "cut it to the part that is needed"
        raise InputError(f"is larger than {max_bytes / 1e6:.0f} MB", str(path), remedy=remedy)
    return bytes(data)


AS_UTF8 = "save it with the encoding UTF-8"


def read_text(path: Path, *, max_bytes: int) -> str:
    """Read a UTF-8 text file (a byte-order mark is dropped) of at most `max_bytes`, without NUL."""
    data = read_bytes(path, max_bytes=max_bytes)
    if is_utf16(data):
        raise InputError("is UTF-16 text", str(path), remedy=AS_UTF8)
    nul = data.find(0)
    if nul >= 0:
        raise InputError(f"is not text: byte {nul} is NUL", str(path))
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        problem = f"is not UTF-8 text (byte {error.start})"
        raise InputError(problem, str(path), remedy=AS_UTF8) from error


def is_utf16(data: bytes) -> bool:
    """Whether bytes are the beginning of a text in UTF-16: its byte-order mark, or every second byte NUL."""
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        return True
    head = data[:200]
    return len(head) >= 4 and any(not any(head[odd::2]) and all(head[1 - odd :: 2]) for odd in (0, 1))


def write_atomically(path: Path, content: str | bytes, *, force: bool = False) -> None:
    """Write a file so that a reader, or a crash, never leaves or sees half of it; errors are those of `writing`."""
    with writing(path, force=force) as stream:
        stream.write(content.encode() if isinstance(content, str) else content)


@contextmanager
def writing(path: Path, *, force: bool = False) -> Iterator[BinaryIO]:
    """Open a file for writing that appears whole when the block ends, and not at all when it fails.

    Raises an `InputError` if the file exists and `force` is false, or if it cannot be written.
    """
    try:
        if path.exists() and not force:
            raise InputError("exists already", str(path), remedy="give another name, or --force to overwrite it")
        descriptor, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        try:
            with os.fdopen(descriptor, "wb") as stream:
                yield stream
                stream.flush()
                os.fsync(stream.fileno())
            mask = os.umask(0)
            os.umask(mask)
            os.chmod(temporary, 0o666 & ~mask)
            os.replace(temporary, path)
        except BaseException:
            os.unlink(temporary)
            raise
    except OSError as error:
        raise file_error("written", path, error) from error
