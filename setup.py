"""The part of the build that pyproject.toml cannot say: the library of compiled kernels (see build_kernels.py)."""

from __future__ import annotations

import sys
from pathlib import Path

from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext

ROOT = Path(__file__).parent
LIBRARY = "skyway.models.jit._kernels"


class BuildKernels(build_ext):
    """Compile the kernels into the wheel; ``make setup`` does it for an editable installation."""

    def run(self) -> None:
        """Compile the library into the folder of what is built."""
        if self.inplace or self.editable_mode:
            return
        sys.path.insert(0, str(ROOT))
        from build_kernels import build

        target = Path(self.get_ext_fullpath(LIBRARY))
        built = build(target.parent.resolve())
        built.replace(target)

    def get_outputs(self) -> list[str]:
        """Return the files made."""
        if self.inplace or self.editable_mode:
            return []
        library = Path(self.get_ext_fullpath(LIBRARY))
        return [str(library), str(library.with_name("_kernels.stamps.json"))]


setup(ext_modules=[Extension(LIBRARY, sources=[])], cmdclass={"build_ext": BuildKernels})
