"""Modules for a user's training code, which has no simtune: each is exported as one file."""

import inspect
from importlib import resources

from simtune.export.training.rows import rows_of_object
from simtune.names import ExportFormat


def module_text(library: ExportFormat) -> str:
    """The text of LIBRARY_worlds.py, with the function that it imports from here inlined."""
    text = resources.files(__name__).joinpath(f"{library}_worlds.py").read_text("utf-8")
    statement = "from simtune.export.training.rows import rows_of_object\n"
    before, found, after = text.partition(statement)
    assert found, f"{library}_worlds.py must import what it shares by one line"
    head, gap, body = after.partition("\n\n\n")
    return f"{before.rstrip()}\n{head}{gap}{inspect.getsource(rows_of_object)}\n\n{body}"
