"""Writes the table of states into its page, and draws it: ``python tests/link/supervision_page.py``."""

import math
from pathlib import Path

from states_picture import picture

from skyway.link.supervisor.states import TABLE
from skyway.models.base.formatting import duration

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGE, PICTURE = DOCS / "explanation" / "supervision.md", DOCS / "assets" / "supervision-states.svg"
BEGIN, END = "<!-- states -->\n", "<!-- /states -->"
LINK = "![States of a supervised delivery, and what may follow what](../assets/supervision-states.svg)"


def markdown():
    """The table of states as a Markdown table."""
    lines = ["| state | meaning | at most | then |", "| --- | --- | --- | --- |"]
    for state, rule in TABLE.items():
        most = "—" if math.isinf(rule.longest_s) else duration(rule.longest_s)
        lines.append(f"| `{state}` | {rule.meaning} | {most} | {f'`{rule.overdue}`' if rule.overdue else '—'} |")
    return "\n".join(lines) + "\n"


def drawn(text):
    """The page with the table as it is now."""
    before, rest = text.split(BEGIN)
    return f"{before}{BEGIN}{LINK}\n\n{markdown()}{END}{rest.split(END)[1]}"


if __name__ == "__main__":
    PAGE.write_text(drawn(PAGE.read_text()))
    PICTURE.write_text(picture())
