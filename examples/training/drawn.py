"""Whether what environments have are worlds that simtune drew."""

from pathlib import Path

import numpy as np


def check_drawn(path: Path | str, **found: np.ndarray) -> None:
    """Each parameter's values (E,) in E environments: together, a row of the draws in `path`."""
    with np.load(path) as worlds:
        drawn = dict(zip(worlds["names"].tolist(), worlds["draws"].T, strict=True))
    same = [np.isclose(drawn[name], values[:, None]) for name, values in found.items()]
    each = np.logical_and.reduce(same)  # (E, W)
    assert each.any(1).all(), f"not drawn: environments {np.flatnonzero(~each.any(1)).tolist()}"
    num = len(each)
    assert len(set(each.argmax(1))) > num / 2, f"{num} environments share too few worlds"
    print(f"{num} environments, each in a world that was drawn")
    for name, values in found.items():
        print(f"  {name}: {values.round(4)}")
