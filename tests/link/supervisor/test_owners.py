"""Each part of a delivery's state is written by the module that owns it, and by no other."""

from __future__ import annotations

import ast
from dataclasses import fields
from pathlib import Path

import pytest

from skyway.link import supervisor
from skyway.link.supervisor.context import Context

ROOM = Path(supervisor.__file__).parent
MODULES = sorted(ROOM.rglob("*.py"))
CHANGES = {"add", "append", "appendleft", "clear", "discard", "extend", "insert", "pop", "popitem", "popleft", "remove", "setdefault", "update"}  # fmt: skip
"""Methods of lists, sets and dictionaries that change them."""


def fields_of(tree):
    """Names of the fields that classes of a module have."""
    found = set()
    for one in ast.walk(tree):
        if isinstance(one, ast.ClassDef):
            found |= {node.target.id for node in ast.walk(one) if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name)}  # fmt: skip
        target = (
            one.targets[0] if isinstance(one, ast.Assign) else one.target if isinstance(one, ast.AnnAssign) else None
        )
        if isinstance(target, ast.Attribute) and isinstance(target.value, ast.Name) and target.value.id == "self":
            found.add(target.attr)
    return found


def written(tree):
    """(attribute, line) of each attribute that is assigned, deleted or changed in place, except those of ``self``."""
    for node in ast.walk(tree):
        targets = []
        if isinstance(node, (ast.Assign, ast.Delete)):
            targets = node.targets
        elif isinstance(node, (ast.AugAssign, ast.AnnAssign)):
            targets = [node.target]
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in CHANGES:
            targets = (
                [] if ast.unparse(node.func.value).endswith(".vehicle") else [node.func.value]
            )  # ``vehicle.clear``
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in ("setattr", "delattr"):
            yield "setattr", node.lineno
        for target in targets:
            for one in target.elts if isinstance(target, (ast.Tuple, ast.List)) else [target]:
                inner = one.value if isinstance(one, ast.Subscript) else one
                if isinstance(inner, ast.Attribute) and not (
                    isinstance(inner.value, ast.Name) and inner.value.id == "self"
                ):
                    yield inner.attr, node.lineno


@pytest.mark.parametrize("path", MODULES, ids=[str(path.relative_to(ROOM)) for path in MODULES])
def test_a_module_writes_only_what_its_own_classes_hold(path):
    tree = ast.parse(path.read_text())
    own = fields_of(tree)
    assert [(name, line) for name, line in written(tree) if name not in own] == []


def test_the_check_sees_what_it_is_meant_to_see():
    wrong = "def step(ctx):\n ctx.battery.soc = 1.0\n ctx.delivery.visited.add('a')\n ctx.delivery.unusable['a'] = 2.0\n ctx.a.b, c = 1, 2\n del ctx.a.c\n ctx.a.d += 1\n setattr(ctx, 'e', 1)\n"  # fmt: skip
    assert {name for name, _ in written(ast.parse(wrong))} == {"soc", "visited", "unusable", "b", "c", "d", "setattr"}


def test_the_parts_are_put_together_once():
    """The context cannot be assigned to; each part is a class of the supervisor or what the delivery was given."""
    assert Context.__dataclass_params__.frozen
    plain = {"int", "float", "str", "bool", "dict", "list", "set", "tuple"}
    assert [one.name for one in fields(Context) if str(one.type).split("[")[0] in plain] == []
    assert len(fields(Context)) <= 22
