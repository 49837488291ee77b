"""Kernel that decodes the LZW compression of TIFF."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from skyway.models.jit.compiled import compiled

if TYPE_CHECKING:
    from numpy.typing import NDArray

_CLEAR, _END, _FIRST = 256, 257, 258


@compiled
def lzw_decoded(data: NDArray[np.uint8], out: NDArray[np.uint8]) -> int:
    """Decode LZW codes, most significant bit first, of 9 to 12 bits, into `out`; returns how many bytes were written.

    Code k from 258 on stands for the string that begins at ``start[k]`` of the output and is ``length[k]`` long: what
    was written for the code before it, and one byte more. Takes any bytes; stops at the end of either array, and at a
    code that no encoder writes.

    Source: TIFF 6.0, section 13.
    """
    start = np.zeros(4097, dtype=np.int64)
    length = np.ones(4097, dtype=np.int64)
    # bits of `data` that wait in `buffer`, and how many
    buffer = np.int64(0)
    waiting = 0
    width = 9
    next_code = _FIRST
    # where the string of the code before begins, and its length; 0 after a clear
    before = 0
    before_length = 0
    written = 0
    at = 0
    while True:
        # the next code
        while waiting < width:
            if at >= len(data):
                return written
            buffer = ((buffer << 8) | np.int64(data[at])) & np.int64(0xFFFFFFF)
            at += 1
            waiting += 8
        code = (buffer >> (waiting - width)) & ((1 << width) - 1)
        waiting -= width
        if code == _END:
            return written
        if code == _CLEAR:
            width, next_code, before_length = 9, _FIRST, 0
            continue
        begin = written
        if code < _CLEAR:
            if written >= len(out):
                return written
            out[written] = code
            written += 1
        else:
            # the code that is being made is the string before and its own first byte
            known = code < next_code
            if not known and (code != next_code or before_length == 0):
                return written
            source = start[code] if known else before
            count = length[code] if known else before_length + 1
            for i in range(count):
                if written >= len(out):
                    return written
                out[written] = out[source + i]
                written += 1
        if before_length > 0 and next_code < 4096:
            start[next_code] = before
            length[next_code] = before_length + 1
            next_code += 1
            # the width changes one code early
            if next_code >= (1 << width) - 1 and width < 12:
                width += 1
        before, before_length = begin, written - begin
