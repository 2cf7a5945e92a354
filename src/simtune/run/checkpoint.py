"""Checkpoints: safetensors and JSON in a numbered folder, which is written atomically.

torch, which takes seconds to load, is loaded with the first tensors: who reads a state needs none.
"""

import hashlib
import json
import logging
import os
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from safetensors import SafetensorError

from simtune.run.files import read_json, sync, sync_folder, write_atomically, write_json

if TYPE_CHECKING:
    import torch

_KEPT_CHECKPOINTS = 2
_TENSORS, _STATE, _MANIFEST = "tensors.safetensors", "state.json", "manifest.json"

log = logging.getLogger(__name__)


def save(folder: Path, tensors: Mapping[str, "torch.Tensor"], state: Mapping[str, Any]) -> Path:
    """Write the next checkpoint into `folder` and keep the latest two; returns its path.

    Tensors may be on any device and share memory; they are loaded on the CPU. `state` must be JSON.
    The checkpoint becomes visible once all of it is on the disk. Raises RuntimeError if it cannot
    be written, e.g. on a full disk; earlier checkpoints stay. Older ones that cannot be removed
    stay as well, with a warning.
    """
    number = max((int(path.name) for path in _numbered(folder)), default=0) + 1
    temporary = folder / f".{number:06d}.tmp"
    path = folder / f"{number:06d}"
    shutil.rmtree(temporary, ignore_errors=True)
    try:
        folder.mkdir(exist_ok=True)
        _write(temporary, tensors, state)
        os.replace(temporary, path)
        sync_folder(folder)
    except (OSError, SafetensorError) as error:
        shutil.rmtree(temporary, ignore_errors=True)  # room for logs
        raise RuntimeError(
            f"cannot write the checkpoint {path}: {error}; make room there, and the same command "
            "goes on from the one before"
        ) from error
    _prune(folder)
    return path


def _write(folder: Path, tensors: Mapping[str, "torch.Tensor"], state: Mapping[str, Any]) -> None:
    from safetensors.torch import save_file

    folder.mkdir()
    save_file(_separate(tensors), folder / _TENSORS)
    sync(folder / _TENSORS)
    # Not write_json: a state must be loaded unchanged, including infinities.
    write_atomically(folder / _STATE, json.dumps(state))
    files = (_TENSORS, _STATE)
    write_json(folder / _MANIFEST, {"sha256": {f: _sha256(folder / f) for f in files}})


def newest(folder: Path, *, warn: bool = True) -> Path | None:
    """The newest sound checkpoint; None: there is none. Warns of each newer, damaged one."""
    for path in reversed(_numbered(folder)):
        damage = _damage(path)
        if damage is None:
            return path
        if warn:
            log.warning("checkpoint %s is damaged (%s): using the one before it", path, damage)
    return None


def load(path: Path) -> tuple[dict[str, "torch.Tensor"], dict[str, Any]]:
    """The tensors, on the CPU, and the state of a checkpoint."""
    from safetensors.torch import load_file

    return load_file(path / _TENSORS), read_json(path / _STATE)


def load_state(path: Path) -> dict[str, Any]:
    """The state of a checkpoint, without the tensors."""
    return read_json(path / _STATE)


def drop_after(folder: Path, last: Path | None) -> None:
    """Remove checkpoints newer than `last`, which are damaged, and folders of killed writes."""
    for path in _numbered(folder):
        if last is None or path.name > last.name:
            shutil.rmtree(path)
    for path in folder.glob(".*.tmp"):
        shutil.rmtree(path)


def _numbered(folder: Path) -> list[Path]:
    """The checkpoints of a folder, oldest first."""
    return sorted(folder.glob("[0-9]" * 6))


def _damage(path: Path) -> str | None:
    """What is wrong with a checkpoint; None if it is sound."""
    try:
        for name, expected in read_json(path / _MANIFEST)["sha256"].items():
            if _sha256(path / name) != expected:
                return f"{name} has changed since it was written"
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        return f"{type(error).__name__}: {error}"
    return None


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _separate(tensors: Mapping[str, "torch.Tensor"]) -> dict[str, "torch.Tensor"]:
    """Contiguous CPU tensors that share no memory, which safetensors would refuse."""
    seen: set[int] = set()
    separate = {}
    for name, tensor in tensors.items():
        tensor = tensor.detach().cpu().contiguous()
        pointer = tensor.untyped_storage().data_ptr()
        separate[name] = tensor.clone() if pointer in seen else tensor
        seen.add(pointer)
    return separate


def _prune(folder: Path) -> None:
    for path in _numbered(folder)[:-_KEPT_CHECKPOINTS]:
        try:
            shutil.rmtree(path)
        except OSError as error:
            log.warning("the old checkpoint %s cannot be removed, and stays: %s", path, error)
