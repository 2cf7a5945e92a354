"""docs/commands: a page a command, whose tables of options are what the command takes.

`python tests/test_docs.py` writes the tables anew.
"""

import ast
import inspect
import re
import textwrap
from dataclasses import MISSING, fields
from pathlib import Path

import pytest

from simtune import config

FOLDER = Path(__file__).parents[1] / "docs" / "commands"
PAGES = {
    "check": config.CheckConfig,
    "tune": config.TuneConfig,
    "train": config.TrainConfig,
    "record": config.RecordConfig,
    "evaluate": config.EvaluateConfig,
    "export": config.ExportConfig,
    "compare": config.CompareConfig,
}
POSITIONAL = {"task": "TASK", "run_folder": "RUN", "other_folder": "RUN"}
TABLE = re.compile(r"\| option \|.*?(?=\n\n|\Z)", re.S)


def documented(cls: type) -> dict[str, str]:
    """What stands below each field, those of base classes first."""
    told: dict[str, str] = {}
    for base in reversed(cls.__mro__[:-1]):
        (body,) = ast.parse(textwrap.dedent(inspect.getsource(base))).body
        assert isinstance(body, ast.ClassDef)
        for field, below in zip(body.body, body.body[1:], strict=False):
            if isinstance(field, ast.AnnAssign) and isinstance(below, ast.Expr):
                assert isinstance(field.target, ast.Name)
                told[field.target.id] = " ".join(ast.literal_eval(below.value).split())
    return told


def table(cls: type) -> str:
    told, lines = documented(cls), ["| option | default | |", "|---|---|---|"]
    for field in fields(cls):
        is_needed = field.default is MISSING
        name = POSITIONAL.get(field.name) or f"--{field.name.replace('_', '-')}"
        plain = "" if field.default is None else f"`{field.default}`"
        plain = "off" if field.default is False else plain
        lines.append(f"| `{name}` | {'needed' if is_needed else plain} | {told[field.name]} |")
    return "\n".join(lines)


@pytest.mark.parametrize("name", PAGES)
def test_a_page_lists_every_option(name):
    page = (FOLDER / f"{name}.md").read_text(encoding="utf-8")
    assert TABLE.search(page)[0].rstrip() == table(PAGES[name])


def test_every_command_has_a_page_and_links_lead_somewhere():
    from simtune import cli

    commands = re.findall(r'subcommand\("(\w+)"\)', inspect.getsource(cli))
    assert {path.stem for path in FOLDER.iterdir()} == set(commands)
    for page in [*FOLDER.iterdir(), *FOLDER.parent.glob("*.md")]:
        for target in re.findall(r"\]\(([^)#:]+)[^):]*\)", page.read_text(encoding="utf-8")):
            assert (page.parent / target).exists(), f"{page.name}: {target}"


if __name__ == "__main__":
    for name, cls in PAGES.items():
        path = FOLDER / f"{name}.md"
        path.write_text(TABLE.sub(lambda _, c=cls: table(c), path.read_text(encoding="utf-8")))
