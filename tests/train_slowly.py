"""Run by test_train.py to be killed: a tiny training, so many rounds long, into a folder."""

import sys
from dataclasses import replace
from pathlib import Path

import torch

from simtune import algorithm, parts
from simtune.config import TrainConfig
from simtune.tasks import load_task

torch.set_num_threads(1)
algorithm._CHECKPOINT_EVERY_S = 0.0
parts.load_task = lambda name: replace(load_task(name), episode_steps=24)
algorithm.train(
    TrainConfig(
        task="cartpole",
        out=Path(sys.argv[1]),
        method="dr",
        policy_steps=int(sys.argv[2]) * 16 * 24,
        real_episodes=1,
        scored_episodes=1,
    )
)
