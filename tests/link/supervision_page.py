"""Writes the table of states into its page: ``python tests/link/supervision_page.py``."""

from pathlib import Path

from link.supervisor.states import markdown, mermaid

PAGE = Path(__file__).resolve().parents[2] / "docs" / "explanation" / "supervision.md"
BEGIN, END = "<!-- states -->\n", "<!-- /states -->"


def drawn(text):
    """The page with the table as it is now."""
    before, rest = text.split(BEGIN)
    return f"{before}{BEGIN}```mermaid\n{mermaid()}```\n\n{markdown()}{END}{rest.split(END)[1]}"


if __name__ == "__main__":
    PAGE.write_text(drawn(PAGE.read_text()))
