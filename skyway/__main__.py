"""``python -m skyway``."""

from skyway.cli.main import run

run()
