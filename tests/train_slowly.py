"""Run by test_train.py to be killed. Arguments: FOLDER ROUNDS, of the policy's training.

All of Algorithm 1 is in it: it films the real world, searches, trains teacher and student.
"""

import sys
from dataclasses import replace
from pathlib import Path

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

torch.set_num_threads(1)
TASKS["cartpole"] = lambda: replace(cartpole.balance(), episode_steps=24)
small = TeacherStudentConfig(
    teacher=TeacherConfig(hidden_size=16, batch_size=8),
    student=StudentConfig(
        detector=DetectorConfig(channels=4, free_maps=2, hidden=16, batch_size=8)
    ),
    random_steps=24,  # nearly all of it is learnt from
)
train(
    TrainConfig(
        task="cartpole",
        out=Path(sys.argv[1]),
        policy_steps=int(sys.argv[2]) * 16 * 24,
        real_episodes=2,
        scored_episodes=1,
    ),
    settings=Settings(
        search=TINY_SEARCH,
        comparison=StartSearchConfig(num_starts=16, rounds=2),
        make_agent=lambda name, spec: TeacherStudent(spec, small),
        checkpoint_every_s=0.0,
    ),
)
