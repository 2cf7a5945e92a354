"""Errors in the user's input, described in one line."""

import difflib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from simtune.columns import cut

_MOST_NAMED = 60
_MATCH_CUTOFF = 0.75  # as difflib counts: a slip of the keyboard, not "light" for "weight"


class InputError(ValueError):
    """The user's input cannot be used; the CLI prints the message and exits with 2."""


class UnknownName(InputError):
    """A name (task, parameter, geom, column, ...) that does not exist where it was looked up."""

    def __init__(self, kind: str, name: str, where: str, known: Iterable[str]):
        super().__init__(f"no {kind} {name!r} in {where}{_hint(name, list(known))}")


def _hint(name: str, known: list[str]) -> str:
    """Which one may be meant, and others unless that is sure."""
    if not known:
        return ", which has none"
    whole = [other for other in known if name and name in other]  # such as palm in robot0:palm
    close = whole or difflib.get_close_matches(name, known)
    is_sure = len(whole) == 1
    if not whole:
        is_sure = bool(difflib.get_close_matches(name, known, cutoff=_MATCH_CUTOFF))
    meant = f"; did you mean {close[0]!r}?" if close else ""
    return meant if is_sure else f"{meant or ';'} there are: {cut(whole or known, _MOST_NAMED)}"


def one_line(error: ValueError) -> str:
    """MuJoCo's message of several lines as one."""
    return " ".join(str(error).split())


@contextmanager
def blame(what: str, kind: type[Exception] = InputError) -> Iterator[None]:
    """Turn whatever a user's code raises, sys.exit() included, into `kind`: what failed, and why.

    Ctrl-C and other orders to end pass.
    """
    try:
        yield
    except InputError:  # already described
        raise
    except BaseException as error:
        if not isinstance(error, Exception) and type(error) is not SystemExit:
            raise
        raise kind(f"{what}: {type(error).__name__}: {error}") from error


class RobotError(RuntimeError):
    """A robot fails, or was asked for what it must not do; the CLI exits with 1."""
