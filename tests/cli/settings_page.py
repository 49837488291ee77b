"""Writes the page of all settings from their classes: ``python tests/cli/settings_page.py``."""

from __future__ import annotations

from pathlib import Path

from skyway.models.base.parameters import entries, text_of
from skyway.settings import Settings

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "settings.md"
HEAD = """# Settings of planners and filters

These are the tuned parameters, generated from their classes (`skyway.settings.Settings`); `skyway settings` lists them too. `skyway plan`, `compare`,
`replay` and `bench planners` accept `--set NAME=VALUE`, several times; separate several numbers by commas. From Python:

```python
from skyway.models.base.parameters import with_values
from skyway.planner.parameters.planner import PlannerParameters

fifty = with_values(PlannerParameters(), {"robust.members": 50})  # plan(..., parameters=fifty)
```

A plan stores those that differ from their defaults (`parameters` in [its file](files.md)). *set by* names the measurement behind a default; if it
is empty, the default was chosen, not measured.
"""


def page() -> str:
    """Return the page."""
    lines: list[str] = [HEAD]
    part = ""
    for one in entries(Settings()):
        if one.name.rpartition(".")[0] != part:
            part = one.name.rpartition(".")[0]
            lines += [
                f"## {part}",
                "",
                "| name | default | unit | range | meaning | set by |",
                "| --- | --- | --- | --- | --- | --- |",
            ]
        name, default = one.name.rpartition(".")[2], text_of(one.default).replace(",", ", ")
        lines.append(f"| `{name}` | {default} | {one.unit} | {one.range_text} | {one.meaning} | {one.measured} |")
    return "\n".join(lines).replace("|\n## ", "|\n\n## ") + "\n"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
