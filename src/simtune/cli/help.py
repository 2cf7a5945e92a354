"""What --help says: a command's own options first, and their texts without line breaks."""

import ast
import inspect
import textwrap
from collections.abc import Iterable, Mapping
from dataclasses import Field, field, fields, make_dataclass
from typing import Annotated, Any, Union, get_type_hints

from tyro.conf import OmitArgPrefixes, arg, subcommand

EXAMPLES = """\
`simtune COMMAND --help` says what each takes. For example:
  simtune check ball_in_cup
  simtune tune ball_in_cup --out runs/ball
  simtune export runs/ball --out tuned

`simtune --version` prints the version, and `simtune --tyro-print-completion bash` (or zsh, fish) a
script for the shell that completes commands, options and files (docs/command-line.md).
"""
# Options that are shown together, below the others; each group belongs to its first option.
_GROUPS = {
    "recordings": ("camera", "actions", "control_hz", "leave_out", "observe"),
    "robot": ("robot", "move"),
    "pseudo-real": ("real_parameters", "start_factor", "real_gap"),
    "camera-pose": ("camera_pose", "within_m", "within_deg", "within_fov_deg", "budget_minutes"),
    "policy": (
        *("agent", "policy_steps", "pretrain_steps"),
        *("tried_episodes", "scored_episodes", "range_policy", "range_dr"),
    ),
    "paper's search": ("range_spm", "step_size", "window"),
}
_FIRST = ("task", "name", "run_folder", "run_folders", "grid", "folder", "out", "real")


def asks_for_help(typed: Iterable[str]) -> bool:
    return any(word in ("-h", "--help") for word in typed)


def with_help(commands: Mapping[str, type], is_brief: bool) -> Any:
    """The union of all commands, for tyro to print and not to make.

    `is_brief`: of all that a command's docstring says, its first sentence.
    """
    told = (
        Annotated[_told(cls, first_sentence(cls) if is_brief else str(cls.__doc__)), subcommand(n)]  # type: ignore[misc]
        for n, cls in commands.items()
    )
    return Union[tuple(told)]  # noqa: UP007


def first_sentence(cls: type) -> str:
    """The first sentence of a class's docstring, in one line."""
    return " ".join(str(cls.__doc__).split()).partition(". ")[0].rstrip(".") + "."


def grouped(cls: type) -> dict[str, list[Field[Any]]]:
    """{title of a group: its options}, as they are shown; first, without a title, all others.

    A command's own options come before those that it shares with others.
    """
    own = cls.__dict__.get("__annotations__", {})
    rank = {name: place for place, name in enumerate(_FIRST)}

    def place(option: Field[Any]) -> tuple[int, bool]:
        return rank.get(option.name, len(rank)), option.name not in own

    every = sorted(fields(cls), key=place)
    names = [option.name for option in every]
    there = {title: its for title, its in _GROUPS.items() if its[0] in names}
    title_of = {name: title for title, its in there.items() for name in its}
    found: dict[str, list[Field[Any]]] = {title: [] for title in ("", *there)}
    for option in every:
        found[title_of.get(option.name, "")].append(option)
    return found


def _told(cls: type, text: str) -> type:
    """A dataclass with the options of `cls` in the order in which they are shown."""
    told, hints = texts(cls), get_type_hints(cls, include_extras=True)

    def shown(options: Iterable[Field[Any]]) -> list[tuple[str, Any, Any]]:
        helps = {o.name: arg(help=told[o.name], help_behavior_hint=_hint(o)) for o in options}
        return [(o.name, Annotated[hints[o.name], helps[o.name]], _same(o)) for o in options]

    groups = grouped(cls)
    entries = shown(groups.pop(""))
    for number, (title, options) in enumerate(groups.items()):
        group = make_dataclass(f"Group{number}", shown(options), kw_only=True)
        kind = Annotated[OmitArgPrefixes[group], arg(name=title)]  # type: ignore[valid-type]
        entries.append((f"group{number}", kind, field(default_factory=group)))
    made = make_dataclass(cls.__name__, entries, kw_only=True)
    made.__doc__ = text
    return made


def _hint(option: Field[Any]) -> Any:
    """None: tyro's own. An option without a default says in its text what happens without it."""
    if option.name == "run_folders":  # tyro takes any number of them
        return "(required)"
    return "" if option.default is None or option.default is False else None


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
