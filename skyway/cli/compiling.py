"""Progress while kernels are compiled: once after an installation from source."""

from __future__ import annotations

import sys

import typer

from skyway.models.jit import compiled


class CompilingNotice:
    """Says on standard error that kernels are being compiled; on a terminal, which one at the moment."""

    def __init__(self) -> None:
        self.count = 0

    def __call__(self, kernel: str) -> None:
        """Tell of a kernel that is about to be compiled; with "", that it is ready."""
        if kernel and not self.count:
            typer.echo("skyway: compiling its numerical kernels, once for this installation: a minute or two", err=True)
        self.count += bool(kernel)
        if sys.stderr.isatty():
            sys.stderr.write(f"\r\033[Kskyway: kernel {self.count}: {kernel}" if kernel else "\r\033[K")
            sys.stderr.flush()


def show_compiling() -> None:
    """Show from now on what is compiled."""
    compiled.watchers[:] = [CompilingNotice()]
