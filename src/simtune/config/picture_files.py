"""Files that a command's pictures may replace: pictures."""

from pathlib import Path

from simtune.errors import InputError

_PNG = b"\x89PNG\r\n\x1a\n"


def check_replaceable(file: Path, asked: Path) -> None:
    """Raises InputError if there is a `file` that is no PNG, where --pictures `asked` for one.

    An empty file may be replaced, too.
    """
    if not file.exists():
        return
    try:
        with file.open("rb") as content:
            begin = content.read(len(_PNG))
    except OSError as error:
        raise InputError(
            f"--pictures {asked}: {file} cannot be replaced: {error.strerror}"
        ) from None
    if begin not in (b"", _PNG):
        raise InputError(
            f"--pictures {asked}: {file} exists and is no PNG, so it is not replaced; name another "
            "file"
        )
