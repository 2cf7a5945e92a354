"""Updates per second of the paper's agent, against a plain implementation of the same.

Both take batches of one replay, with the paper's sizes, in turns within one run, since only ratios
of one run compare on a shared machine. The last line is one JSON object.
"""

import json
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
import tyro
from baselines.eager_curl_sac import EagerCurlSac
from common import machine, record_figures

from simtune.agents.curl_sac import CurlSac, CurlSacConfig
from simtune.parameters import Parameter, ParameterSpace
from simtune.replay_buffer import Episodes, ReplayBuffer

_NUM_ACTIONS, _NUM_EPISODES, _EPISODE_STEPS = 6, 10, 50  # actions as the walker's
_SPACE = ParameterSpace(
    [Parameter(name="mass", field="opt.o", nominal=1.0, low=0.1, high=10.0, unit="kg")]
)


def a_replay(config: CurlSacConfig, device: torch.device) -> ReplayBuffer:
    """Filled with noise: how long an update takes does not depend on what there is to learn."""
    rng = np.random.default_rng(0)
    n, steps, size = _NUM_EPISODES, _EPISODE_STEPS, config.image_size
    replay = ReplayBuffer(_SPACE, filmed_capacity=n, num_stacked=config.num_stacked, device=device)
    replay.add(
        Episodes(
            parameters=np.ones((n, 1)),
            full_states=np.zeros((n, steps + 1, 1)),
            states=np.zeros((n, steps + 1, 1), np.float32),
            actions=rng.uniform(-1, 1, (n, steps, _NUM_ACTIONS)).astype(np.float32),
            rewards=rng.uniform(0, 1, (n, steps)).astype(np.float32),
            lengths=np.full(n, steps),
            terminated=np.zeros(n, bool),
            frames=rng.integers(256, size=(n, steps + 1, size, size, 3), dtype=np.uint8),
        )
    )
    return replay


def updates_per_s(update: Callable[[int], object], num_updates: int, device: torch.device) -> float:
    """Of `num_updates` in a row."""
    start = time.perf_counter()
    update(num_updates)
    if device.type == "cuda":
        torch.cuda.synchronize(device)
    return num_updates / (time.perf_counter() - start)


def main(
    device: str = "cpu", rounds: int = 7, record: Path | None = None, quick: bool = False
) -> None:
    """Measure it.

    Args:
        device: Where to compute.
        rounds: Turns of each.
        record: Write the figures into this file of docs/results, too.
        quick: Fewer rounds: within a minute.
    """
    config, place = CurlSacConfig(random_steps=0), torch.device(device)
    replay = a_replay(config, place)
    ours = CurlSac(_NUM_ACTIONS, config, seed=0, device=place)
    theirs = EagerCurlSac(_NUM_ACTIONS, config, place)
    generator = torch.Generator(place).manual_seed(0)

    def update_ours(num_updates: int) -> None:
        ours.update(replay, num_updates)
        ours.update(replay, 0)  # does those that are due

    def update_theirs(num_updates: int) -> None:
        for _ in range(num_updates):
            theirs.update(replay, generator)

    # An even number, half of which move the actor and the targets.
    num_updates = 200 if place.type == "cuda" else 2 if quick else 4
    update_ours(20 if place.type == "cuda" else 2)  # allocates, and captures graphs
    update_theirs(2)
    figures: list[tuple[float, float]] = []
    for round_ in range(3 if quick else rounds):
        mine = updates_per_s(update_ours, num_updates, place)
        other = updates_per_s(update_theirs, num_updates, place)
        figures.append((mine, other))
        print(f"round {round_}: {mine:.2f} updates/s, eager {other:.2f}", file=sys.stderr)
    median, eager = np.median(figures, axis=0)
    ratios = [mine / other for mine, other in figures]
    hardware = machine()
    hardware["hardware"] |= {"threads": torch.get_num_threads()}
    if place.type == "cuda":
        hardware["hardware"] |= {"gpu": torch.cuda.get_device_name(place)}
    result = {
        "device": device,
        "batch_size": config.batch_size,
        "updates_per_s": round(float(median), 3),
        "eager_updates_per_s": round(float(eager), 3),
        "ratio_to_eager": round(float(np.median(ratios)), 2),
        **hardware,
    }
    row = {
        "what": f"agent on {device}, threads: {torch.get_num_threads()}",
        "unit": "updates/s",
        "ours": result["updates_per_s"],
        "other": result["eager_updates_per_s"],
        "ratio": result["ratio_to_eager"],
    }
    record_figures(record, ("what",), [row])
    print(json.dumps(result))


if __name__ == "__main__":
    tyro.cli(main)
