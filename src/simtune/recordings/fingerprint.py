"""A fingerprint of recordings, which shows whether they have changed."""

import hashlib
from collections.abc import Iterable
from pathlib import Path

_BLOCK = 1 << 20  # bytes
_BLOCKS = 64


def fingerprint(root: Path, files: Iterable[Path]) -> str:
    """SHA-256 over names, sizes and contents of files, as hex.

    For a file of more than 64 MiB, only 64 blocks of 1 MiB are read, evenly spread over the file:
    terabytes cannot be read at every start.
    """
    digest = hashlib.sha256()
    for path in sorted(path for path in files if path.is_file()):
        size = path.stat().st_size
        name = path.relative_to(root).as_posix() if path.is_relative_to(root) else path.name
        digest.update(f"{name}\n{size}\n{_content(path, size)}\n".encode())
    return digest.hexdigest()


def _content(path: Path, size: int) -> str:
    with path.open("rb") as file:
        if size <= _BLOCK * _BLOCKS:
            return hashlib.file_digest(file, "sha256").hexdigest()
        digest = hashlib.sha256()
        for block in range(_BLOCKS):
            file.seek(block * (size - _BLOCK) // (_BLOCKS - 1))
            digest.update(file.read(_BLOCK))
        return digest.hexdigest()
