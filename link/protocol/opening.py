"""Opening a connection from command-line settings: recorded, with the signing key from a file or the environment."""

from __future__ import annotations

import binascii
import os
from pathlib import Path
from typing import TYPE_CHECKING

from skyway.link.forwarding.forwarder import Forwarder
from skyway.link.forwarding.permission import Permission
from skyway.link.protocol.connection import GROUND_SYSTEM, PLANNER_COMPONENT, Connection
from skyway.link.wire.address import parse_address
from skyway.link.wire.recorder import Recorder
from skyway.link.wire.redundant import RedundantTransport
from skyway.link.wire.signing import Signing
from skyway.link.wire.transport import open_transport
from skyway.models.base.clock import WallClock
from skyway.models.base.errors import Fault, InputError
from skyway.models.base.files import read_bytes

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.link.wire.transport import Transport
    from skyway.models.base.address import Address

KEY_VARIABLE = "SKYWAY_SIGNING_KEY"
"""Environment variable with the signing key in hexadecimal digits."""
KEY_FILE_VARIABLE = "SKYWAY_SIGNING_KEY_FILE"
"""Environment variable that names a file with it."""
_KEY_BYTES = 32


def read_key(file: Path | None = None) -> bytes | None:
    """Signing key from a file (32 bytes, or 64 hexadecimal digits), or else from the environment; None for no key.

    The environment holds 64 hexadecimal digits (`KEY_VARIABLE`) or names a file (`KEY_FILE_VARIABLE`). An `InputError`
    means that the file cannot be read, that others may read it, or that it contains no key. It never shows the key.
    """
    text = os.environ.get(KEY_VARIABLE, "").strip()
    if file is None and not text and os.environ.get(KEY_FILE_VARIABLE):
        file = Path(os.environ[KEY_FILE_VARIABLE])
    if file is not None:
        if os.name == "posix" and file.exists() and file.stat().st_mode & 0o077:
            remedy = f"chmod 600 {file}"
            raise InputError(Fault("others may read the signing key", str(file), remedy=remedy))
        return _key_of(read_bytes(file, max_bytes=4096), str(file))
    if len(text) == _KEY_BYTES:  # digits, not bytes: half a key
        raise _no_key(KEY_VARIABLE)
    return None if not text else _key_of(text.encode(), KEY_VARIABLE)


def _key_of(data: bytes, where: str) -> bytes:
    if len(data) == _KEY_BYTES:
        return data
    try:
        key = binascii.unhexlify(data.strip())
    except (binascii.Error, ValueError):
        key = b""
    if len(key) != _KEY_BYTES:
        raise _no_key(where)
    return key


def _no_key(where: str) -> InputError:
    return InputError(Fault("has no signing key", where, remedy="64 hexadecimal digits, or 32 bytes in a file"))


def check_system(system: int, option: str) -> None:
    """Refuse what is no MAVLink system id; 0 addresses every system."""
    if not 1 <= system <= 255:
        raise InputError(Fault("out of range", field=option, value=system, remedy="1 to 255"))


def open_connection(
    text: str | Sequence[str],
    *,
    record: Path | None,
    system: int = GROUND_SYSTEM,
    key: bytes | None = None,
    forward: Sequence[str] = (),
    permission: Permission = Permission.PILOT,
) -> Connection:
    """Open a connection string, or several (radios to the same vehicle), such as ``udpin:127.0.0.1:14540``, with our system id, 1-255, and a signing key.

    It is recorded in the folder `record`; None records nothing, which is only for tests. Other ground stations at the addresses
    `forward` share it, and may send commands allowed by `permission`. An `InputError` or `LinkLostError` means that it cannot be opened.
    """
    check_system(system, "--gcs-system")
    texts = [text] if isinstance(text, str) else list(text)
    addresses = [parse_address(one) for one in texts]
    if not addresses or len(set(map(str, addresses))) < len(addresses):
        raise InputError(Fault("the same radio twice", field="--connect", value=", ".join(texts)))
    address = addresses[0]
    clock = WallClock()
    signing = None if key is None else Signing(key)
    recorder = None if record is None else Recorder(record, clock, name=f"{address.kind}-{address.port}")
    forwarder = None
    try:
        if forward:
            signed = (lambda: None) if key is None else lambda: _signing(key, clock)
            forwarder = Forwarder(forward, permission, own=(system, PLANNER_COMPONENT), signing=signed)
        transport = _open_radios(addresses)
    except Exception:
        if forwarder is not None:
            forwarder.close()
        if recorder is not None:
            recorder.close()
            for path in recorder.paths:
                path.unlink(missing_ok=True)  # no communication took place
        raise
    return Connection(transport, clock, recorder=recorder, system=system, signing=signing, forwarder=forwarder)


def _open_radios(addresses: Sequence[Address]) -> Transport:
    """Open one radio, or several as one; if one cannot be opened, the others are closed again."""
    opened: list[tuple[str, Transport]] = []
    try:
        for address in addresses:
            opened.append((str(address), open_transport(address)))  # noqa: PERF401  what was opened is closed below
    except Exception:
        for _, one in opened:
            one.close()
        raise
    return opened[0][1] if len(opened) == 1 else RedundantTransport(opened)


def _signing(key: bytes, clock: WallClock) -> Signing:
    """State of a signed link to a client."""
    made = Signing(key)
    made.advance_to(clock.posix_s())
    return made
