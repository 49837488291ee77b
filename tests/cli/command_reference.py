"""Writes the page of all commands from the commands themselves: ``python tests/cli/command_reference.py``."""

from __future__ import annotations

import re
from pathlib import Path

import typer

from skyway.cli.main import app

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "commands.md"
HEAD = """# Commands

Generated from the commands; `skyway COMMAND --help` prints the same.

| exit code | meaning |
| --- | --- |
| 0 | done |
| 1 | the answer is no: no route, no drone lifts the package, errors found in a mission; or an answer that fails its audit |
| 2 | wrong usage or input; one line per fault on stderr, nothing is written |
| 3 | the vehicle or the link to it failed |
| 130 | interrupted |

Percent appears only in options; files have fractions. Times need an offset from UTC. Files are overwritten only with
`--force`. The answer goes to standard output, warnings and errors to standard error.
"""


def walk(group, path=("skyway",)):
    """All commands, as (words, command)."""
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from walk(command, (*path, name))
        else:
            yield (*path, name), command


def example_lines(help_: str) -> list[str]:
    return [line.strip() for line in help_.splitlines() if line.strip().startswith("skyway ")]


def prose(help_: str) -> str:
    text = re.split(r"\n\s*Examples?:", help_.replace("\b", ""))[0]
    return "\n\n".join(" ".join(part.split()) for part in re.split(r"\n\s*\n", text) if part.strip())


def cell(text: object) -> str:
    return " ".join(str(text).split()).replace("|", "\\|").replace("][", "]\\[")  # two brackets would be a link


def default(parameter) -> str:
    if parameter.required:
        return "required"
    value = parameter.default
    if value is None or value is False or callable(value):
        return ""
    return f"`{getattr(value, 'value', value)}`"


def describe(words, command) -> str:
    help_ = command.help or ""
    lines = [f"## {' '.join(words)}", "", prose(help_), "", "```text", *example_lines(help_), "```", ""]
    lines += ["| argument or option | meaning | default |", "| --- | --- | --- |"]
    for parameter in command.params:
        if "--help" in parameter.opts:
            continue
        is_option = parameter.opts[0].startswith("-")
        name = ", ".join(f"`{opt}`" for opt in parameter.opts) if is_option else f"`{parameter.name.upper()}`"
        lines.append(f"| {name} | {cell(parameter.help or '')} | {default(parameter)} |")
    return "\n".join(lines) + "\n"


def page() -> str:
    parts = [describe(words, command) for words, command in sorted(walk(typer.main.get_command(app)), key=order)]
    return "\n".join((HEAD, *parts))


def order(item) -> int:
    names = ["plan", "compare", "network", "wind", "init", "check", "mission", "convert", "show", "sim"]
    words = item[0]
    key = words[-1] if len(words) == 2 or words[-1] == "init" else "init"
    return names.index(key) if key in names else len(names)


if __name__ == "__main__":
    PAGE.write_text(page())
