"""NumPy's NAME.npz: arrays that are read when asked for, since pictures fill the memory."""

import tokenize
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from simtune.errors import InputError

UNREADABLE = (
    OSError,
    ValueError,
    EOFError,
    KeyError,
    RuntimeError,  # encrypted; packed in a way that is not implemented
    tokenize.TokenError,  # from NumPy, of a header
    zipfile.BadZipFile,
    zlib.error,
)
_HEADERS = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}
_SUFFIX = ".npy"


class Npz(Mapping[str, np.ndarray]):
    """{name: array}, each read from the file anew. Raises InputError for what is damaged."""

    def __init__(self, path: Path):
        self._path = path
        try:
            with zipfile.ZipFile(path) as file:
                members = [name for name in file.namelist() if name.endswith(_SUFFIX)]
                self._looks = {name.removesuffix(_SUFFIX): _look(file, name) for name in members}
        except UNREADABLE as error:
            raise self._damaged(error) from None

    def __getitem__(self, key: str) -> np.ndarray:
        if key not in self._looks:
            raise KeyError(key)
        if self._looks[key].dtype.hasobject:
            raise InputError(
                f"{self._path}: {key} holds Python objects, which are not loaded from files; "
                "expected numbers, or texts: numpy.array(names, dtype=str)"
            )
        try:
            with np.load(self._path, allow_pickle=False) as file:
                return file[key]
        except UNREADABLE as error:
            raise self._damaged(error) from None

    def __iter__(self) -> Iterator[str]:
        return iter(self._looks)

    def __len__(self) -> int:
        return len(self._looks)

    def look(self, key: str) -> np.ndarray:
        """An array of the shape and the type, without the content."""
        return self._looks[key]

    def _damaged(self, error: Exception) -> InputError:
        reason = str(error).splitlines()[0] if str(error) else "damaged"
        return InputError(
            f"{self._path}: not readable as arrays ({reason}); expected a file of numpy.savez"
        )


def _look(file: zipfile.ZipFile, name: str) -> np.ndarray:
    """One number that stands for all of the array, so that it takes no memory."""
    with file.open(name) as member:
        version = np.lib.format.read_magic(member)
        if version not in _HEADERS:  # columns with names: no numbers
            return np.empty((), object)
        shape, _, dtype = _HEADERS[version](member)
    return np.broadcast_to(np.empty((), dtype), shape)
