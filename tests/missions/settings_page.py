"""Writes the page of parameters from their tables: ``python tests/missions/settings_page.py``."""

from pathlib import Path

from skyway.missions.autopilots.registry import FAMILIES
from skyway.missions.autopilots.settings import MAIN

PAGE = Path(__file__).resolve().parents[2] / "docs" / "reference" / "parameters.md"
HEAD = """# Parameters by firmware version

Generated from the tables that skyway uses (`settings.py` in `missions/autopilots/px4` and `ardupilot`). A setting has one meaning, but its name
and unit depend on the firmware. skyway asks a vehicle for every known name, since builds between two
versions have some of the new names. If a vehicle has none of them, preflight stops within seconds and lists the names. For a firmware
newer than this table, give the name of the parameter, here with the plan of
[Your first delivery](../tutorial/first-delivery.md):

<!-- after: tutorial/first-delivery.md -->
<!-- not run: a firmware that is not there yet -->
```sh
skyway fly delivery.json --parameter-name mission-speed=WP_SPEED:m/s
```

`skyway mission --firmware 4.6` writes a parameter file for that version; `skyway upload --parameters` sets what such a file
says on a vehicle of any version.
"""


def _span(name, autopilot):
    first, last = autopilot.firmwares[0], autopilot.firmwares[-1]
    since = "" if name.since <= _number(first) else f"from {name.since[0]}.{name.since[1]}"
    until = "" if name.until > _number(last) else f"before {name.until[0]}.{name.until[1]}"
    return " ".join(filter(None, (since, until))) or "all"


def _number(text):
    return MAIN if text == "main" else tuple(int(part) for part in text.split("."))


def page():
    lines = [HEAD]
    for autopilot in sorted(FAMILIES.values(), key=lambda found: found.name):
        known = ", ".join(autopilot.firmwares)
        lines += [
            f"## {autopilot.name} ({known})",
            "",
            "| setting | what it is | name | unit | versions |",
            "| --- | --- | --- | --- | --- |",
        ]
        for key in autopilot.settings.keys:
            setting = autopilot.settings[key]
            for name in setting.names:
                lines.append(f"| `{key}` | {setting.words} | `{name.name}` | {name.unit} | {_span(name, autopilot)} |")
        lines.append("")
    return "\n".join(lines)


if __name__ == "__main__":
    PAGE.write_text(page())
