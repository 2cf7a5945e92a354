"""The files that a tuning file consists of: itself, its model, meshes, pictures, code."""

import html
import os
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

_XML = (".xml", ".mjcf", ".urdf")  # which write "&" as "&amp;"
_TEXTS = (".toml", ".py", *_XML)  # files that may name others
# Each quote with the next alike, so that a lone apostrophe in a comment hides no name
_QUOTED = re.compile(r"""(?="([^"\n]+)"|'([^'\n]+)')""")
# Such as "0 1e-3", of which a model has many; ".." and "2" may be folders
_NUMBERS = re.compile(r"(?=.*\d)(?!\d+$)[-+.\deE\s]+")
_PACKAGE = re.compile(r"package:/+([^/]+)/(.+)")
_IN_CODE = re.compile(r"(.+\.py):\w+")
_IMPORT = re.compile(r"^\s*(?:from|import)\s+(\w+)", re.MULTILINE)


def named_files(first: Path) -> tuple[Path, ...]:
    """`first`, an absolute path, and all files that it names, directly or through other files.

    All quoted texts are looked up beside all these files, and in folders that any of them names
    (MJCF's meshdir, which is seen from the folder of the including file), so the result may contain
    files that are not used.
    """
    found: dict[Path, set[str]] = {}
    new = [first]
    while new:
        found |= {file: set(_names(file)) for file in new}
        names = set().union(*found.values())
        beside = {str(file.parent) for file in found}
        folders = beside | set(filter(os.path.isdir, _joined(beside, names)))
        files = sorted(filter(os.path.isfile, _joined(folders, names)))
        new = [file for file in map(Path, files) if file not in found]
    return tuple(found)


def _joined(folders: Iterable[str], names: Iterable[str]) -> set[str]:
    return {os.path.normpath(os.path.join(folder, name)) for folder in folders for name in names}


def _names(file: Path) -> Iterator[str]:
    """Texts in a file that may be names of other files."""
    if (kind := file.suffix.lower()) not in _TEXTS:
        return
    text = file.read_text(encoding="utf-8", errors="ignore")
    for quoted in ("".join(either) for either in _QUOTED.findall(text)):
        quoted = html.unescape(quoted) if kind in _XML else quoted
        if match := _IN_CODE.fullmatch(quoted):
            yield match[1]
        elif _PACKAGE.fullmatch(quoted):
            yield str(in_package(quoted, file) or Path(quoted).name)
        elif not _NUMBERS.fullmatch(quoted):
            yield quoted
    if file.suffix == ".py":
        for module in _IMPORT.findall(text):
            yield f"{module}.py"
            yield from map(str, (file.parent / module).rglob("*.py"))


def in_package(named: str, file: Path) -> Path | None:
    """What "package://NAME/FILE" in a `file`, an absolute path, means; None if it is not there.

    The package is a folder NAME that holds `file`, or is beside such a folder. In copies of its
    files its upper folders are missing, so the last parts of FILE are looked for as well, two or
    more of them: a bare name may be another file's.
    """
    if not (words := _PACKAGE.fullmatch(named)):
        return None
    package, inner = words[1], Path(words[2])
    places = [folder / package / inner for folder in file.parents]
    places += [folder / inner for folder in file.parents if folder.name == package]
    places += [file.parent / inner, file.parent / inner.name]
    parts = [Path(*inner.parts[i:]) for i in range(len(inner.parts) - 1)]
    places += [folder / part for part in parts for folder in file.parents]
    return next((place for place in places if place.is_file()), None)
