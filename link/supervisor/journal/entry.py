"""Entries of the journal as typed values: written as plain JSON, and read from any file."""

from __future__ import annotations

from collections.abc import Callable, Mapping  # noqa: TC003  the annotations are read at run time
from functools import cache
from types import NoneType, UnionType
from typing import Annotated, Any, ClassVar, Self, Union, get_args, get_origin, get_type_hints

import msgspec

from skyway.link.supervisor.journal import fields as of
from skyway.models.base.json_text import plain

Share = Annotated[float | None, "share"]
"""A number from 0 to 1, or unknown."""
Place = tuple[float, float]
"""Latitude and longitude, degrees."""


class Part(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A group of values.

    A field without a default is always written, as null if unknown; one with a default is omitted if it
    has that value. Reading never fails: missing values, and those of another type or out of bounds, are unknown.
    """

    SPREAD: ClassVar[Mapping[str, str]] = {}
    """Fields whose parts are in the same JSON object, each with this prefix of their names."""

    def to_json(self) -> dict[str, Any]:
        """Return its JSON object."""
        data: dict[str, Any] = {}
        for name, value in msgspec.structs.asdict(self).items():
            if name in self.SPREAD:
                inner = value.to_json() if isinstance(value, Part) else dict(value or {})
                data |= {self.SPREAD[name] + str(key): plain(one) for key, one in inner.items()}
            elif name not in _defaults(type(self)) or value != _defaults(type(self))[name]:
                data[name] = plain(value)
        return data

    @classmethod
    def read(cls, data: Mapping[str, Any]) -> Self:
        """Read it from a JSON object of a journal."""
        given: dict[str, Any] = {}
        readers = _readers(cls)
        others = {key: value for key, value in data.items() if key not in readers} if cls.SPREAD else {}
        for name, read in readers.items():
            prefix = cls.SPREAD.get(name)
            if prefix is not None:
                inner = {key[len(prefix) :]: value for key, value in others.items() if key.startswith(prefix)}
                given[name] = read({name: inner}, name)
            else:
                given[name] = read(data, name)
        return cls(**given)


class Entry(Part, frozen=True, kw_only=True):
    """Data of a journal record besides its sentence; the tag of its class is the event of the record."""

    @classmethod
    def event(cls) -> str:
        """Type of its record in the journal."""
        return str(cls.__struct_config__.tag)


@cache
def _defaults(kind: type[Part]) -> dict[str, Any]:
    return {one.name: one.default for one in msgspec.structs.fields(kind) if not one.required}


@cache
def _readers(kind: type[Part]) -> dict[str, Callable[[Mapping[str, Any], str], Any]]:
    """Return a reader for each field of a type of part."""
    hints = get_type_hints(kind, include_extras=True)
    return {one.name: _reader(hints[one.name]) for one in msgspec.structs.fields(kind)}


def _reader(hint: Any) -> Callable[[Mapping[str, Any], str], Any]:
    if get_origin(hint) is Annotated:
        return of.share
    wanted = (
        [one for one in get_args(hint) if one is not NoneType] if get_origin(hint) in (Union, UnionType) else [hint]
    )
    (one,) = wanted
    if get_origin(one) is tuple:
        return _tuple_reader(get_args(one)[0])
    if isinstance(one, type) and issubclass(one, Part):
        return lambda data, key: one.read(of.table(data, key))
    return _PLAIN[get_origin(one) or one]


def _tuple_reader(inner: Any) -> Callable[[Mapping[str, Any], str], Any]:
    if isinstance(inner, type) and issubclass(inner, Part):
        return lambda data, key: tuple(map(inner.read, of.tables(data, key)))
    if inner is str:
        return lambda data, key: tuple(of.words(data, key))
    return lambda data, key: tuple(of.places(data, key))


_PLAIN: dict[Any, Callable[[Mapping[str, Any], str], Any]] = {
    float: of.number, int: of.integer, str: of.text, bool: of.truth, dict: of.table,
}  # fmt: skip
