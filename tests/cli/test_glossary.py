"""The glossary names code that exists."""

import re
from importlib import import_module
from pathlib import Path

import pytest

from skyway.planner.registry import PLANNERS

GLOSSARY = Path(__file__).parents[2] / "docs" / "reference" / "glossary.md"
ROWS = [
    [*re.findall(r"`([^`]+)`", here), "->", *re.findall(r"`([^`]+)`", where)]
    for _, here, where in re.findall(r"^\| ([^|]+) \| ([^|]+) \| ([^|]+) \|$", GLOSSARY.read_text(), re.MULTILINE)
]
"""Names of each row of the paper's symbols, then ``->``, then modules."""


def names_and_modules():
    modules = []
    for row in ROWS:
        arrow = row.index("->")
        modules = row[arrow + 1 :] or modules  # "the same"
        yield from ((name, modules) for name in row[:arrow])


def known(name, module):
    parts = [module, *(getattr(module, one) for one in dir(module) if isinstance(getattr(module, one), type))]
    return any(hasattr(part, name) or name in getattr(part, "__annotations__", {}) for part in parts)


@pytest.mark.parametrize(("name", "modules"), [one for one in names_and_modules() if one[0] not in PLANNERS])
def test_a_name_in_the_glossary_is_in_one_of_the_modules_beside_it(name, modules):
    assert any(known(name, import_module(f"skyway.{module}")) for module in modules), (name, modules)


def test_every_module_in_the_glossary_exists():
    for row in ROWS:
        for module in row[row.index("->") + 1 :]:
            assert import_module(f"skyway.{module}")


def test_words_are_in_alphabetical_order():
    words = re.findall(r"^\| ([^|]+) \| [^|]+ \|$", GLOSSARY.read_text().split("## Words")[1], re.MULTILINE)
    words = [word for word in words if word not in ("word", "---")]
    assert words == sorted(words, key=str.casefold)
