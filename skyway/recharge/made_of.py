"""The inputs of a cut mission, stored beside its flights so that `fly` can replan the rest.

The mission, its pads and the fleet are copied; terrain, zones, forecasts and scenarios are referenced by name. There is a digest of every file.
"""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from skyway.missions.autopilots import NAMES
from skyway.missions.autopilots.registry import family_named
from skyway.missions.files.mission_file import read
from skyway.models.airspace.pressure import resolved, split_pressure
from skyway.models.airspace.reading import read_airspace
from skyway.models.base.errors import Fault, InputError
from skyway.models.base.files import read_bytes, read_text
from skyway.models.base.json_text import json_text, plain
from skyway.recharge.asking import Asked, options_of, pads_of, region_of, stands_of, with_home
from skyway.recharge.output import SUMMARY, mission_texts
from skyway.recharge.recharged import recharged

if TYPE_CHECKING:
    from collections.abc import Mapping

    from skyway.missions.items.document import MissionDocument
    from skyway.models.airspace.airspace import Airspace
    from skyway.models.scenario.scenario import Scenario
    from skyway.recharge.cutting import Recharged

SCHEMA = "skyway.recharge-set/1"
SET, COPIES = "set.json", "made-of"
DRONE_MISSION = "mission.plan"
"""The mission of one of several drones."""
MAX_BYTES = 50_000_000
CUT_AGAIN = "cut the mission again with skyway recharge"


@dataclass(frozen=True, slots=True, kw_only=True)
class MadeOf:
    """Typed options of a cut, and their files."""

    asked: Asked
    mission: Path
    autopilot: str | None = None
    zones: tuple[Path, ...] = ()
    authorized: tuple[str, ...] = ()
    written: str | None = None
    """The mission, if it was generated and is not yet a file."""


@dataclass(frozen=True, eq=False, slots=True)
class OpenedSet:
    """A folder written by `skyway recharge`, read and recomputed."""

    folder: Path
    made_of: MadeOf
    document: MissionDocument
    region: Scenario | None
    zones: Airspace | None
    found: Recharged
    sha256: str


def texts_of(made_of: MadeOf, region: Scenario | None, texts: Mapping[str, str]) -> dict[str, str | bytes]:
    """Return the files written beside those of a set: copies, and the list of all."""
    asked = made_of.asked
    copied: dict[str, bytes] = {}

    def kept(path: Path, written: str | None = None) -> str:
        name = f"{COPIES}/{path.name}"
        content = read_bytes(path, max_bytes=MAX_BYTES) if written is None else written.encode()
        if copied.setdefault(name, content) != content:
            name = f"{COPIES}/{len(copied)}-{path.name}"
            copied[name] = content
        return name

    named = {
        "mission": kept(made_of.mission, made_of.written),
        "pads": kept(asked.pads) if region is None and asked.pads is not None else None,
        "fleet": None if asked.fleet is None else kept(asked.fleet),
        "vans": None if asked.vans is None else kept(asked.vans),
    }
    others = [*(split_pressure(one)[0] for one in made_of.zones), *(asked.forecast or ())]
    others += [Path(one.partition("@")[0]) for one in (*(asked.terrain or ()), *(asked.obstacles or ()))]
    inputs = {str(path.resolve()): _digest(path) for path in others if path.is_file()}
    digests = {name: _sha(text.encode()) for name, text in texts.items()}
    digests |= {name: _sha(content) for name, content in copied.items()}
    typed = asdict(asked) | {name: value for name, value in named.items() if value is not None}
    data: dict[str, Any] = {
        "schema": SCHEMA,
        "asked": plain({name: _plain(value) for name, value in typed.items()}),
        "autopilot": made_of.autopilot,
        "zones": [resolved(path) for path in made_of.zones],
        "authorized": list(made_of.authorized),
        "scenario_sha256": None if region is None else region.sha256,
        "inputs": inputs,
        "files": digests,
    }
    data["sha256"] = _of(data)
    return {**copied, SET: json_text(data, indent=1) + "\n"}


def _plain(value: Any) -> Any:
    """Return an option in its JSON form; files by their absolute path, since the folder may be flown from another place."""
    if isinstance(value, Path):
        return str(value.resolve()) if value.exists() else str(value)
    if isinstance(value, list):
        return [_plain(one) for one in value]
    if isinstance(value, str) and value.partition("@")[0] and Path(value.partition("@")[0]).is_file():
        name, at, frame = value.partition("@")
        return f"{Path(name).resolve()}{at}{frame}"
    return value


def _sha(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _digest(path: Path) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _of(data: Mapping[str, Any]) -> str:
    rest = {name: value for name, value in data.items() if name != "sha256"}
    return _sha(json.dumps(rest, sort_keys=True).encode())


def opened(folder: Path) -> OpenedSet:
    """Read the folder of a cut mission and recompute it.

    An `InputError` names missing, edited, and changed files.
    """
    data = _listed(folder)
    _check_files(folder, data)
    asked = _asked(folder, data)
    made_of = MadeOf(
        asked=asked,
        mission=folder / str(data["asked"]["mission"]),
        autopilot=data["autopilot"],
        zones=tuple(Path(one) for one in data["zones"]),
        authorized=tuple(data["authorized"]),
    )
    document = with_home(read(made_of.mission), asked)
    region = region_of(asked)
    if region is not None and region.sha256 != data["scenario_sha256"]:
        raise InputError("has changed since the mission was cut", region.path, field="scenario", remedy=CUT_AGAIN)
    zones = _zones(made_of, region)
    families = [family_named(name) for name in ((made_of.autopilot,) if made_of.autopilot else NAMES)]
    stands = stands_of(asked)
    chosen = options_of(asked, document, region, zones, stands)
    found = recharged(document, pads_of(asked, region, stands), families, chosen)
    texts = mission_texts(found)
    differ = [name for name, text in texts.items() if data["files"].get(name) != _sha(text.encode())]
    if differ:
        problem = f"this version of skyway would cut the mission differently ({differ[0]} differs)"
        raise InputError(problem, str(folder), remedy=CUT_AGAIN)
    return OpenedSet(folder, made_of, document, region, zones, found, str(data["sha256"]))


def sets_in(folder: Path) -> tuple[Path, ...]:
    """Return the folders of the drones in a folder: itself, one for each of several drones, or none."""
    if (folder / SET).is_file():
        return (folder,)
    found: list[Path] = []
    while (one := folder / f"drone-{len(found) + 1}") and (one / SET).is_file():
        found.append(one)
    return tuple(found)


def _listed(folder: Path) -> dict[str, Any]:
    """Return the contents of the list of a folder, unedited."""
    file = folder / SET
    if not file.is_file() and sets_in(folder):
        remedy = f"fly {folder / 'drone-1'} and the others, each with its own skyway, started together"
        raise InputError("is the work of several drones", str(folder), remedy=remedy)
    if not file.is_file():
        what = "is incomplete, or was written by an older skyway" if (folder / SUMMARY).is_file() else "is none"
        remedy = CUT_AGAIN if (folder / SUMMARY).is_file() else "name a folder that skyway recharge -o wrote"
        raise InputError(f"{SET} is missing: the folder of a cut mission {what}", str(folder), remedy=remedy)
    try:
        data = json.loads(read_text(file, max_bytes=MAX_BYTES))
    except (ValueError, RecursionError) as error:
        raise InputError(f"is not JSON: {error}", str(file), remedy=CUT_AGAIN) from None
    if not isinstance(data, dict) or data.get("schema") != SCHEMA:
        found = data.get("schema") if isinstance(data, dict) else None
        raise InputError("has another schema", str(file), field="schema", value=found, remedy=f"expected {SCHEMA}")
    if data.get("sha256") != _of(data):
        raise InputError("was edited since the mission was cut", str(file), field="sha256", remedy=CUT_AGAIN)
    return data


def _check_files(folder: Path, data: Mapping[str, Any]) -> None:
    """Refuse a folder with a missing or edited file, or with changed inputs."""
    faults = []
    for name, digest in data["files"].items():
        path = folder / name
        if not path.is_file():
            faults.append(
                Fault("is missing: the folder is incomplete", str(path), remedy="copy it whole, or " + CUT_AGAIN)
            )
        elif _digest(path) != digest:
            remedy = "edit the mission that was cut, and " + CUT_AGAIN
            faults.append(Fault("was edited since the mission was cut", str(path), remedy=remedy))
    for name, digest in data["inputs"].items():
        path = Path(name)
        if not path.is_file():
            faults.append(Fault("was removed since the mission was cut with it", name, remedy=CUT_AGAIN))
        elif _digest(path) != digest:
            faults.append(Fault("has changed since the mission was cut", name, remedy=CUT_AGAIN))
    if faults:
        raise InputError(faults)


def _asked(folder: Path, data: Mapping[str, Any]) -> Asked:
    """Return the typed options; a digest confirms that they were not edited."""
    told = {name: value for name, value in data["asked"].items() if name != "mission"}
    for name in ("pads", "fleet", "vans"):
        if isinstance(told.get(name), str) and str(told[name]).startswith(f"{COPIES}/"):
            told[name] = folder / told[name]
        elif told.get(name) is not None:
            told[name] = Path(told[name])
    if told.get("windows") is not None:
        told["windows"] = {
            pad: [[-math.inf if first is None else first, math.inf if last is None else last] for first, last in each]
            for pad, each in told["windows"].items()
        }
    if told.get("forecast") is not None:
        told["forecast"] = [Path(one) for one in told["forecast"]]
    known = Asked.__dataclass_fields__
    strange = sorted(set(told) - set(known))
    if strange:
        raise InputError(
            f"has options that this version of skyway does not know: {', '.join(strange)}",
            str(folder / SET),
            remedy=CUT_AGAIN,
        )
    return replace(Asked(), **told)


def _zones(made_of: MadeOf, region: Scenario | None) -> Airspace | None:
    """Return the zones that the mission was cut with."""
    from skyway.models.airspace.airspace import Airspace

    own = None if region is None else region.network.zones
    if not made_of.zones and not made_of.authorized:
        return own
    more, _ = read_airspace(made_of.zones)
    known = own or Airspace()
    return replace(known, zones=(*known.zones, *more)).with_authorized(made_of.authorized)
