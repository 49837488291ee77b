"""Zones: volumes of air that are closed, need an authorization, or have conditions, and when."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from skyway.models.airspace.activation import ALWAYS, Activation
from skyway.models.airspace.limits import GROUND, NO_CEILING, Limit

if TYPE_CHECKING:
    import shapely

Kind = Literal["prohibited", "authorization", "conditional", "information"]
KINDS: tuple[Kind, ...] = ("prohibited", "authorization", "conditional", "information")
"""From the strictest. The first is closed, the second is closed without an authorization; the others are only reported."""
CLOSING: tuple[Kind, ...] = KINDS[:2]


@dataclass(frozen=True, slots=True)
class Volume:
    """A part of a zone.

    Attributes
    ----------
    area : shapely.Polygon or shapely.MultiPolygon
        Longitude and latitude (x, y), degrees.
    floor, ceiling : Limit
        Both included.
    """

    area: shapely.Geometry
    floor: Limit = GROUND
    ceiling: Limit = NO_CEILING

    def __str__(self) -> str:
        return f"{self.floor} to {self.ceiling}"


@dataclass(frozen=True, slots=True)
class Zone:
    """A zone of an airspace file.

    Attributes
    ----------
    id : str
        Of the publisher, otherwise its name; authorizations refer to it.
    name : str
        Name for people, in English if it has an English name.
    kind : Kind
        ``prohibited``, ``authorization``, ``conditional`` or ``information``.
    volumes : tuple of Volume
        At least one.
    activation : Activation
        When it counts.
    source : str
        The file that it is from.
    message, authority : str
        The publisher's message, and the authority that gives authorizations; empty if not stated.
    """

    id: str
    name: str
    kind: Kind
    volumes: tuple[Volume, ...]
    activation: Activation = ALWAYS
    source: str = ""
    message: str = ""
    authority: str = ""

    @property
    def label(self) -> str:
        """Id and name, once if they are the same."""
        return self.id if self.name in ("", self.id) else f"{self.id} ({self.name})"
