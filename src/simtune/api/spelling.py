"""Messages as Python's users read them."""

import re
from collections.abc import Iterator
from contextlib import contextmanager

from simtune.errors import InputError
from simtune.run.config import FILMED

_OPTION = re.compile(r"(?<![\w/.-])--([a-z][a-z-]+)")  # and no part of a path
# A file in which an episode from memory was put
_EPISODE = re.compile(rf"^[^:]*/{FILMED}/[0-9a-f]{{16}}/episode_(\d+)\.npz(?=: )")


@contextmanager
def in_python() -> Iterator[None]:
    """Spell messages as in Python: budget_minutes, not --budget-minutes.

    An episode that was given as arrays is real[0], not the file that has it.
    """
    try:
        yield
    except InputError as error:
        text = _OPTION.sub(lambda found: found[1].replace("-", "_"), str(error))
        error.args = (_EPISODE.sub(r"real[\1]", text),)
        raise
