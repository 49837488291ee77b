"""Compile the kernels of the source into one shared library, ahead of time: what a wheel is built with.

``models/jit/kernels.json`` lists which kernels, for which types of arguments. ``python build_kernels.py FOLDER`` writes the
library there; `setup.py` calls `build`. ``python build_kernels.py list FOLDER`` writes the list. `entries` says which kernels Python code calls, and `observed` for which types
a process has called them: that is how the tests keep the list complete (``make kernels`` writes it again).
"""

from __future__ import annotations

import ast
import json
import re
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parent
PACKAGE = "skyway"
FLOORS = ("models", "planner", "link")
"""Folders with kernels; the package has them as skyway.models and so on."""
LIST = ROOT / PACKAGE / "models" / "jit" / "kernels.json"
DECORATORS = {"compiled", "compiled_inline", "compiled_lean"}


def build(folder: Path, name: str = "_kernels") -> Path:
    """Compile every listed kernel into a library in a folder; returns its path.

    Needs numba and a C compiler. The code runs on every processor of this architecture.
    """
    from numba.core.typing import Signature
    from numba.pycc import CC

    sys.path.insert(0, str(ROOT))
    from skyway.models.jit.library import stamp_for, stamps_of, symbol

    folder.mkdir(parents=True, exist_ok=True)
    for old in (*folder.glob(f"{name}.*.so"), stamps_of(folder, name)):
        old.unlink(missing_ok=True)  # a process that has it open keeps it
    compiler = CC(name, source_module="skyway.models")
    compiler.output_dir = str(folder)
    stamps = {}
    for kernel_name, all_kinds in json.loads(LIST.read_text(encoding="utf-8")).items():
        module, _, function = kernel_name.rpartition(".")
        kernel = getattr(import_module(module), function)
        stamps[kernel_name] = stamp_for(kernel.skyway_stamp, all_kinds)
        kernel = getattr(kernel, "compiled", kernel)  # where another library is in use
        for number, kinds in enumerate(all_kinds):
            exported = symbol(kernel_name, number)
            try:
                arguments = tuple(_numba_type(kind) for kind in kinds)
                kernel.compile(arguments)
            except Exception as error:
                raise RuntimeError(f"{kernel_name} is not compiled for {kinds}; run: make kernels") from error
            answer = kernel.overloads[_overload(kernel, arguments)].signature.return_type
            compiler.export(exported, Signature(answer, arguments, None))(_wrapper(kernel, exported, len(kinds)))
    compiler.compile()
    stamps_of(folder, name).write_text(json.dumps(stamps, indent=0), encoding="utf-8")
    return Path(compiler.output_dir) / compiler.output_file


def _overload(kernel: Any, arguments: tuple[Any, ...]) -> Any:
    """Return the key of what was compiled for these arguments; defaults that are not given stand behind them."""
    return next(key for key in kernel.overloads if key[: len(arguments)] == arguments)


def _wrapper(kernel: Any, name: str, count: int) -> Any:
    """Return a function that calls a kernel: the kernel itself is compiled with its own options."""
    arguments = ", ".join(f"a{number}" for number in range(count))
    namespace = {"kernel": kernel}
    exec(f"def {name}({arguments}):\n    return kernel({arguments})\n", namespace)  # noqa: S102  names of the list
    return namespace[name]


def _numba_type(kind: Any) -> Any:
    """Return numba's type for one of the list."""
    from numba import types

    if isinstance(kind, str):
        return types.boolean if kind == "bool" else getattr(types, kind)
    tag, *parts = kind
    if tag == "array":
        element, dimensions, layout, writeable = parts
        return types.Array(_numba_type(element), dimensions, layout, readonly=not writeable)
    if tag == "tuple":
        return types.Tuple(tuple(map(_numba_type, parts)))
    module, _, cls = parts[0].partition(":")
    inner = tuple(map(_numba_type, parts[1:]))
    found = getattr(import_module(module), cls)
    return types.NamedUniTuple(inner[0], len(inner), found) if len(set(inner)) == 1 else types.NamedTuple(inner, found)


def _kind(numba_type: Any) -> Any:
    """Return a type of numba as the list has it."""
    from numba import types

    if isinstance(numba_type, types.Array):
        return ["array", _kind(numba_type.dtype), numba_type.ndim, numba_type.layout, numba_type.mutable]
    if isinstance(numba_type, types.BaseNamedTuple):
        cls = numba_type.instance_class
        return ["named", f"{cls.__module__}:{cls.__qualname__}", *map(_kind, numba_type)]
    if isinstance(numba_type, types.BaseTuple):
        return ["tuple", *map(_kind, numba_type)]
    if isinstance(numba_type, types.Number | types.Boolean | types.NoneType):
        return str(numba_type)
    raise TypeError(f"no name in the list for {numba_type}")


def entries() -> set[str]:
    """Return the kernels, ``module.function``, that code which is not compiled refers to."""
    sources = [path for floor in FLOORS for path in sorted((ROOT / PACKAGE / floor).rglob("*.py"))]
    texts = {".".join(path.relative_to(ROOT).with_suffix("").parts): path.read_text() for path in sources}
    kernels = {
        f"{module}.{node.name}"
        for module, text in texts.items()
        if "@compiled" in text
        for node in ast.parse(text).body
        if isinstance(node, ast.FunctionDef) and _is_kernel(node)
    }
    homes = {name.rpartition(".")[0] for name in kernels}
    words = {home.rpartition(".")[2] for home in homes}  # who imports a kernel names its module
    callers = [name for name, text in texts.items() if name in homes or words & set(re.findall(r"\w+", text))]
    return {name for module in callers for name in _referred(module, ast.parse(texts[module])) if name in kernels}


def _is_kernel(node: ast.AST) -> bool:
    decorators = getattr(node, "decorator_list", [])
    return any(isinstance(decorator, ast.Name) and decorator.id in DECORATORS for decorator in decorators)


def _referred(module: str, tree: ast.Module) -> set[str]:
    """Return what the code of a module that is not compiled may refer to, as ``module.name``."""
    homes = {
        alias.asname or alias.name: f"{node.module}.{alias.name}"
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    plain = [node for node in tree.body if not _is_kernel(node)]
    parts = [part for node in plain for part in ast.walk(node)]
    names = {part.id for part in parts if isinstance(part, ast.Name)}
    of_modules = {
        f"{homes[part.value.id]}.{part.attr}"
        for part in parts
        if isinstance(part, ast.Attribute) and isinstance(part.value, ast.Name) and part.value.id in homes
    }
    return {homes.get(name, f"{module}.{name}") for name in names} | of_modules


def observed() -> dict[str, list[list[Any]]]:
    """Return for which types of arguments this process has called, compiled or loaded each kernel that Python code calls."""
    from numba import types

    found: dict[str, list[list[Any]]] = {}
    for name in sorted(entries()):
        module, _, function = name.rpartition(".")
        kernel = getattr(sys.modules.get(module), function, None)
        if called := getattr(kernel, "called", None):
            found[name] = json.loads(json.dumps(called))
        for signature in getattr(kernel, "nopython_signatures", []):
            given = [_kind(argument) for argument in signature.args if not isinstance(argument, types.Omitted)]
            if (kinds := json.loads(json.dumps(given))) not in found.setdefault(name, []):
                found[name].append(kinds)
    return found


def write_list(folder: Path) -> None:
    """Write the list again from what processes have observed, one JSON file each in a folder."""
    found: dict[str, list[Any]] = {}
    for path in sorted(folder.glob("*.json")):
        for name, all_kinds in json.loads(path.read_text(encoding="utf-8")).items():
            kept = found.setdefault(name, [])
            kept += [kinds for kinds in all_kinds if kinds not in kept]
    rows = [f"{json.dumps(name)}: {json.dumps(sorted(found[name], key=json.dumps))}" for name in sorted(found)]
    LIST.write_text("{\n" + ",\n".join(rows) + "\n}\n", encoding="utf-8")


if __name__ == "__main__":
    if sys.argv[1] == "list":
        write_list(Path(sys.argv[2]))
    else:
        build(Path(sys.argv[1]))
