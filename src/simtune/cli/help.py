"""What --help says: a command's own options first, and their texts without line breaks."""

import ast
import inspect
import textwrap
from collections.abc import Iterable, Mapping
from dataclasses import Field, field, fields, make_dataclass
from typing import Annotated, Any, Union, get_type_hints

from tyro.conf import arg, subcommand

EXAMPLES = """\
`simtune COMMAND --help` says what each takes. For example:
  simtune check ball_in_cup
  simtune tune ball_in_cup --out runs/ball
  simtune export runs/ball --out tuned
"""


def asks_for_help(typed: Iterable[str]) -> bool:
    return any(word in ("-h", "--help") for word in typed)


def with_help(commands: Mapping[str, type]) -> Any:
    """The union of all commands, for tyro to print and not to make."""
    told = (Annotated[_told(cls), subcommand(name)] for name, cls in commands.items())  # type: ignore[misc]
    return Union[tuple(told)]  # noqa: UP007


def _told(cls: type) -> type:
    """A dataclass with the options of `cls` in the order in which they are shown."""
    told, hints = texts(cls), get_type_hints(cls, include_extras=True)
    own = cls.__dict__.get("__annotations__", {})
    options: list[tuple[str, Any, Any]] = []
    for option in sorted(fields(cls), key=lambda option: option.name not in own):
        help_ = arg(help=told[option.name], help_behavior_hint=_hint(option))
        options.append((option.name, Annotated[hints[option.name], help_], _same(option)))
    made = make_dataclass(cls.__name__, options, kw_only=True)
    made.__doc__ = cls.__doc__
    return made


def _hint(option: Field[Any]) -> Any:
    """None: tyro's own. An option without a default says in its text what happens without it."""
    return "" if option.default is None else None


def _same(option: Field[Any]) -> Any:
    return field(default=option.default, default_factory=option.default_factory)  # type: ignore[call-overload]


def texts(cls: type) -> dict[str, str]:
    """{option: the text below it}, of its class and of those that it inherits from."""
    found: dict[str, str] = {}
    for base in reversed(cls.__mro__[:-1]):
        (body,) = ast.parse(textwrap.dedent(inspect.getsource(base))).body
        assert isinstance(body, ast.ClassDef)
        for option, below in zip(body.body, body.body[1:], strict=False):
            if isinstance(option, ast.AnnAssign) and isinstance(below, ast.Expr):
                assert isinstance(option.target, ast.Name)
                found[option.target.id] = " ".join(ast.literal_eval(below.value).split())
    return found
