"""The layers of docs/architecture.md: every import points to a lower line of that list."""

import ast
from collections.abc import Iterator
from pathlib import Path

_ROOT = Path(__file__).parents[1]
_SOURCES = _ROOT / "src" / "simtune"


def _rooms() -> set[str]:
    """The folders and files of the package, without their endings."""
    files = {path.stem for path in _SOURCES.glob("*.py") if not path.name.startswith("__")}
    return files | {path.parent.name for path in _SOURCES.glob("*/__init__.py")}


def _floors() -> dict[str, int]:
    """{room: height of its line in the list of layers}."""
    text = (_ROOT / "docs" / "architecture.md").read_text()
    block = text.split("## Layers")[1].split("```")[1].strip()
    lines = [line for line in block.splitlines() if not line.startswith(" ")]
    named = [line.split("   ")[0].split() for line in reversed(lines)]
    return {room: height for height, rooms in enumerate(named) for room in rooms}


def _imports() -> Iterator[tuple[str, str, str]]:
    """(room, imported room, place) of all imports, also of those within functions."""
    for path in sorted(_SOURCES.rglob("*.py")):
        room = path.relative_to(_SOURCES).parts[0].removesuffix(".py")
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("simtune."):
                other = str(node.module).split(".")[1]
                if other != room and not room.startswith("__"):
                    yield room, other, f"{path.relative_to(_ROOT)}:{node.lineno}"


def test_the_list_of_layers_names_every_folder_and_file():
    assert set(_floors()) == _rooms()


def test_every_import_points_to_a_lower_layer():
    floors = _floors()
    climbs = [place for room, other, place in _imports() if floors[other] >= floors[room]]
    assert not climbs
