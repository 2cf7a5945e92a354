"""The command line: `simtune COMMAND --help` says what each takes."""

from simtune.cli.program import main

__all__ = ["main"]
