"""docs/architecture.md: what it names in `code` is in the code, and every path leads somewhere."""

import ast
import re
from collections.abc import Iterator
from dataclasses import fields
from functools import cache
from pathlib import Path

import mujoco

from simtune import config

ROOT = Path(__file__).parents[2]
SOURCES = ROOT / "src" / "simtune"
PAGE = ROOT / "docs" / "architecture.md"
NAME = re.compile(r"[A-Za-z_][\w.]*")
OF_RUNS = ("sources/",)  # folders of a run


def in_code(text: str) -> list[str]:
    """What a page has between backticks, outside of its blocks."""
    return re.findall(r"`([^`\n]+)`", re.sub(r"```.*?```", "", text, flags=re.DOTALL))


def _defined(tree: ast.AST) -> Iterator[str]:
    """Functions, classes, arguments, what is assigned to, and keys of JSON."""
    for node in ast.walk(tree):
        match node:
            case ast.FunctionDef(name=name) | ast.ClassDef(name=name) | ast.arg(arg=name):
                yield name
            case ast.Name(id=name, ctx=ast.Store()) | ast.Attribute(attr=name, ctx=ast.Store()):
                yield name
            case ast.Constant(value=str(text)) if text.isidentifier():
                yield text


@cache
def names_by_file() -> dict[Path, frozenset[str]]:
    """What each file of src defines, with the names of its folders and its own."""
    return {
        path: frozenset(_defined(ast.parse(path.read_text(encoding="utf-8"))))
        | {*path.relative_to(SOURCES).with_suffix("").parts}
        for path in SOURCES.rglob("*.py")
    }


def unknown_names(text: str) -> list[str]:
    """Names in `code` that no file of src defines, nor MuJoCo; all parts of a.b must be in one."""
    names = [name for name in in_code(text) if NAME.fullmatch(name) and not is_path(name)]
    return [
        name
        for name in names
        if not any({*name.split(".")} <= its for its in names_by_file().values())
        and not hasattr(mujoco, name)
    ]


def is_path(token: str) -> bool:
    return re.fullmatch(r"[\w./-]+(/|\.(py|md|json|npz|toml|html|jsonl))", token) is not None


def lost_paths(text: str) -> list[str]:
    """Paths in `code` that lead nowhere from the repository, from src/simtune or a folder in it."""
    paths = [token for token in in_code(text) if is_path(token)]
    return [
        path
        for path in paths
        if path not in OF_RUNS
        and not (ROOT / path).exists()
        and not any(SOURCES.rglob(path.rstrip("/")))
    ]


def unknown_options(text: str) -> list[str]:
    """Options in `code` that no command has."""
    classes = [its for its in vars(config).values() if hasattr(its, "__dataclass_fields__")]
    known = {f"--{f.name.replace('_', '-')}" for its in classes for f in fields(its)}
    options = [token.split()[0] for token in in_code(text) if token.startswith("--")]
    return [option for option in options if option not in known]


def test_every_name_path_and_option_of_the_architecture_exists():
    text = PAGE.read_text(encoding="utf-8")
    assert unknown_names(text) == [], "of no class, function, field or key in src/simtune"
    assert lost_paths(text) == []
    assert unknown_options(text) == []


def test_what_does_not_exist_is_noticed():
    said = "The `ReplayBufer`, `Agent.actt`, `Agent.act`, `agents/agnt.py` by `--serch`"
    assert unknown_names(said) == ["ReplayBufer", "Agent.actt"]
    assert lost_paths(said + ", not `agents/agent.py` or `agents/`") == ["agents/agnt.py"]
    assert unknown_options(said + ", `--search paper`") == ["--serch"]


def test_contributors_are_told_where_the_recipes_are():
    assert "## Recipes" in PAGE.read_text(encoding="utf-8")
    assert "architecture.md#recipes" in (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
