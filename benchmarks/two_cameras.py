"""One camera against two, in a room that the model does not know.

A world of examples/aloha, as in aloha.py, with a photograph on the table. One camera hangs above
it; a second one is mounted on the left wrist, behind a lens that distorts. Exposure drifts, and a
hand passes below the upper camera. `simtune tune` looks at the readings and at the upper camera,
and then at the readings and at both.

Each result is a file in OUT, and is not measured again. Prints a table in Markdown; the last line
is one JSON object.
"""

import json
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import tyro
from common import QUICK, kept_in, machine, record_figures
from two_arms import room
from two_arms.score import print_table, rows, score
from two_arms.settings import WorldSettings
from two_arms.world import World, film

from simtune.config import TuneConfig
from simtune.experiment.settings import Settings as RunSettings
from simtune.run.files import read_json
from simtune.tasks import Task, load_task
from simtune.tuning_run import tune

_OBSERVE = {"one": "over_the_table,joints", "two": "cameras,joints"}


@dataclass(frozen=True, kw_only=True)
class Settings(WorldSettings):
    """Measure it."""

    out: Path = Path("runs/two_cameras")
    """Folder for the recordings and the runs."""
    quick: bool = False
    """A search that finds nothing, by two short episodes."""


def main(settings: tyro.conf.OmitArgPrefixes[Settings]) -> None:
    if not settings.task.with_name("model").exists():
        sys.exit(f"{settings.task}: no model beside it; run examples/aloha/prepare.sh first")
    if settings.quick:
        settings = replace(settings, episodes=2, steps=24, minutes=0.1)
    with kept_in(settings.out, settings.quick) as out:
        folder = out / f"world-{settings.seed}"
        folder.mkdir(exist_ok=True)
        text = settings.task.read_text().replace(
            '"model/', f'"{settings.task.parent.resolve()}/model/'
        )
        (folder / "film.toml").write_text(room.filmed_file(text))
        (folder / "tune.toml").write_text(room.tuning_file(text))
        task = load_task(str(folder / "tune.toml"))
        assert isinstance(task, Task)
        world = World.draw(task.parameters, task.sensors[0].size, settings.seed)
        if not (folder / "recordings").exists():
            _film(folder, world, settings)
        scores = {name: score(task, world, _tuned(folder, name, settings)) for name in _OBSERVE}
    table = rows(task, settings.seed, scores)
    print_table(table)
    if not settings.quick:
        record_figures(settings.record, ["world", "parameter"], table)
    about = {"benchmark": "two_cameras", "quick": settings.quick, **machine()}
    print(json.dumps({**about, "cameras": scores}))


def _film(folder: Path, world: World, settings: Settings) -> None:
    task = load_task(str(folder / "film.toml"))
    assert isinstance(task, Task)
    out, seed = folder / "recordings", settings.seed
    size = settings.episodes, settings.steps
    film(room.furnished(task), world, out, *size, seed, room.WIDTHS, room.as_recorded)


def _tuned(folder: Path, name: str, settings: Settings) -> dict[str, Any]:
    """What a run makes of the recordings, now or before."""
    path = folder / name / "result.json"
    if not path.exists():
        config = TuneConfig(
            task=str(folder / "tune.toml"),
            real=str(folder / "recordings"),
            out=folder / name,
            observe=_OBSERVE[name],
            seed=settings.seed,
            budget_minutes=settings.minutes,
        )
        tune(config, settings=RunSettings(search=QUICK) if settings.quick else None)
    return read_json(path)


if __name__ == "__main__":
    tyro.cli(main)
