"""Run by test_train.py to be killed: a tiny training, so many rounds long, into a folder.

All of Algorithm 1 is in it: looks at the real world, searches, teacher and student.
"""

import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

import torch
from tiny_search import TINY_SEARCH

from simtune import agents, algorithm, comparison, parts, presets
from simtune.agents.student import StudentConfig
from simtune.agents.teacher import TeacherConfig
from simtune.agents.teacher_student import TeacherStudent, TeacherStudentConfig
from simtune.config import TrainConfig
from simtune.tasks import load_task
from simtune.vision.detector import DetectorConfig

torch.set_num_threads(1)
algorithm._CHECKPOINT_EVERY_S = 0.0
small = TeacherStudentConfig(
    teacher=TeacherConfig(hidden_size=16, batch_size=8),
    student=StudentConfig(
        detector=DetectorConfig(channels=4, free_maps=2, hidden=16, batch_size=8)
    ),
    random_steps=24,  # nearly all of it is learnt from
)
agents.TeacherStudent = partial(TeacherStudent, config=small)
presets._SHORTER = TINY_SEARCH
comparison._NUM_STARTS, comparison._ROUNDS = 16, 2
parts.load_task = lambda name: replace(load_task(name), episode_steps=24)
algorithm.train(
    TrainConfig(
        task="cartpole",
        out=Path(sys.argv[1]),
        policy_steps=int(sys.argv[2]) * 16 * 24,
        real_episodes=2,
        scored_episodes=1,
    )
)
