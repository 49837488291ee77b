"""Colours that stand beside each other are told apart by the colour-blind, too: simulated after Machado, Oliveira and Fernandes (2009), severity 1."""

from __future__ import annotations

import itertools
import re
from importlib import resources

import pytest

SIGHT = {
    "usual": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "protanopia": ((0.152286, 1.052583, -0.204868), (0.114503, 0.786281, 0.099216), (-0.003882, -0.048116, 1.051998)),
    "deuteranopia": ((0.367322, 0.860646, -0.227968), (0.280085, 0.672501, 0.047413), (-0.011820, 0.042940, 0.968881)),
    "tritanopia": ((1.255528, -0.076749, -0.178779), (-0.078411, 0.930809, 0.147602), (0.004733, 0.691367, 0.303900)),
}
TO_XYZ = ((0.4124, 0.3576, 0.1805), (0.2126, 0.7152, 0.0722), (0.0193, 0.1192, 0.9505))
WHITE = (0.9505, 1.0, 1.089)
BARS = ("fly", "wait", "charge", "hold")
MAP = ("map-route", "map-vehicle", "map-start", "map-target", "map-warn", "map-other")


def colours(scheme):
    """Linear red, green and blue of each name of the style sheet."""
    css = (resources.files("skyway.web") / "static" / "page.css").read_text()
    begin = css.index('[data-theme="dark"]' if scheme == "dark" else ":root {")
    found = re.findall(r"--([\w-]+): #(\w{6})", css[begin : css.index("}", begin)])
    parts = {name: [int(digits[i : i + 2], 16) / 255 for i in (0, 2, 4)] for name, digits in found}
    return {
        name: [v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4 for v in rgb] for name, rgb in parts.items()
    }


def times(matrix, vector):
    return [sum(a * b for a, b in zip(row, vector, strict=True)) for row in matrix]


def lab(rgb):
    x, y, z = (
        (v / w) ** (1 / 3) if v / w > 0.008856 else 7.787 * v / w + 16 / 116
        for v, w in zip(times(TO_XYZ, rgb), WHITE, strict=True)
    )
    return 116 * y - 16, 500 * (x - y), 200 * (y - z)


@pytest.mark.parametrize("sight", SIGHT)
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize(("names", "least"), [(BARS, 14.0), (MAP, 9.0)], ids=["bars", "map"])
def test_colours_are_told_apart(sight, scheme, names, least):
    known = colours(scheme)
    seen = {name: lab([min(1.0, max(0.0, v)) for v in times(SIGHT[sight], known[name])]) for name in names}
    for one, other in itertools.combinations(names, 2):
        assert sum((a - b) ** 2 for a, b in zip(seen[one], seen[other], strict=True)) ** 0.5 >= least, (one, other)
