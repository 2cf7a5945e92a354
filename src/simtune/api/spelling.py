"""Messages as Python's users read them."""

import re
from collections.abc import Iterator
from contextlib import contextmanager

from simtune.errors import InputError

_OPTION = re.compile(r"(?<![\w/.-])--([a-z][a-z-]+)")  # and no part of a path


@contextmanager
def in_python() -> Iterator[None]:
    """Spell options in messages as in Python: budget_minutes, not --budget-minutes."""
    try:
        yield
    except InputError as error:
        text = _OPTION.sub(lambda found: found[1].replace("-", "_"), str(error))
        error.args = (text,)
        raise
