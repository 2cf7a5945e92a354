"""Run by test_train.py to be killed. Arguments: FOLDER ROUNDS, of the policy's training.

All of Algorithm 1 is in it: it films the real world, searches, trains teacher and student.
"""

import sys
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import torch
from tiny_search import TINY_SEARCH

from simtune.agents.student import StudentConfig
from simtune.agents.teacher import TeacherConfig
from simtune.agents.teacher_student import TeacherStudent, TeacherStudentConfig
from simtune.algorithm import train
from simtune.comparison import StartSearchConfig
from simtune.config import TrainConfig
from simtune.experiment.settings import Settings
from simtune.tasks import TASKS, cartpole
from simtune.vision.detector import DetectorConfig

SMALL = TeacherStudentConfig(
    teacher=TeacherConfig(hidden_size=16, batch_size=8),
    student=StudentConfig(
        detector=DetectorConfig(channels=4, free_maps=2, hidden=16, batch_size=8)
    ),
    random_steps=24,  # nearly all of it is learnt from
)


def train_slowly(out: Path, rounds: int) -> None:
    """A checkpoint after every round; the same to the last bit in every process."""
    config = TrainConfig(
        task="cartpole", out=out, policy_steps=rounds * 16 * 24, real_episodes=2, scored_episodes=1
    )
    settings = Settings(
        search=TINY_SEARCH,
        comparison=StartSearchConfig(num_starts=16, rounds=2),
        make_agent=lambda name, spec: TeacherStudent(spec, SMALL),
        checkpoint_every_s=0.0,
    )
    with patch.dict(TASKS, cartpole=lambda: replace(cartpole.balance(), episode_steps=24)):
        train(config, settings=settings)


if __name__ == "__main__":
    torch.set_num_threads(1)
    train_slowly(Path(sys.argv[1]), int(sys.argv[2]))
