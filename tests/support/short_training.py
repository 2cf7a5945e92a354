"""Trainings that take seconds and find nothing. Run by test_train.py to be killed: FOLDER ROUNDS

All of Algorithm 1 is in them: they film the real world, search, train teacher and student.
"""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import torch
from tiny_search import TINY_SEARCH

from simtune.agents import Agent, AgentSpec, make_agent
from simtune.agents.student import StudentConfig
from simtune.agents.teacher import TeacherConfig
from simtune.agents.teacher_student import TeacherStudent
from simtune.agents.teaching_schedule import TeacherStudentConfig
from simtune.algorithm import train
from simtune.before_after.start_search import StartSearchConfig
from simtune.config import UNTUNED, TrainConfig
from simtune.experiment.schedule import SCHEDULES, Schedule, fast
from simtune.experiment.settings import Settings
from simtune.search_param_model.paper import PaperConfig
from simtune.tasks import TASKS, Task, cartpole
from simtune.vision.detector import DetectorConfig

STEPS, WORLDS = 24, 4  # of an episode, and in which a policy acts
# It begins to act on pictures within a few rounds.
EARLY = TeacherStudentConfig(
    teacher=TeacherConfig(hidden_size=16, batch_size=8),
    student=StudentConfig(
        detector=DetectorConfig(channels=4, free_maps=2, hidden=16, batch_size=8),
        hidden_size=16,
        batch_size=16,
    ),
    teacher_share=0.2,
    random_steps=24,
    teacher_updates_per_step=0.1,
    detector_updates_per_step=(0.02, 0.02),
    head_updates_per_step=0.1,
    trusting_share=0.05,
)


def make_early_agent(name: str, spec: AgentSpec) -> Agent:
    return TeacherStudent(spec, EARLY) if name == "teacher_student" else make_agent(name, spec)


QUICK = Settings(
    search=TINY_SEARCH,
    start_search=StartSearchConfig(num_starts=16, rounds=2),
    make_agent=make_early_agent,
)


@contextmanager
def short_episodes() -> Iterator[None]:
    """Those of cartpole have few steps; a policy acts in few worlds at once, on small pictures."""

    def small(*given, **options) -> Schedule:
        return replace(fast(*given, **options), num_worlds=WORLDS, image_size=32)

    def short() -> Task:
        return replace(cartpole.balance(), episode_steps=STEPS)

    with patch.dict(TASKS, cartpole=short), patch.dict(SCHEDULES, fast=small):
        yield


def config_of(out: Path, rounds: int = 4, **changes) -> TrainConfig:
    """With few episodes, as far as the method and the real world use any."""
    asked: dict[str, Any] = {"task": "cartpole", "policy_steps": rounds * WORLDS * STEPS}
    if changes.get("method") not in UNTUNED:
        asked["real_episodes"] = 2
    if changes.get("real", "pseudo") == "pseudo":
        asked["scored_episodes"] = 2
    return TrainConfig(out=out, **asked | changes)


def by_few_windows(config: TrainConfig) -> Settings:
    """For --method regression: a few small steps, not forty."""
    few = PaperConfig(
        episode_steps=STEPS,
        collect_steps=0,
        crop_size=28,
        episodes_per_iteration=5,
        updates_per_episode=1,
        batch_size=2,
        num_candidates=4,
        hidden_size=8,
    )
    steps, real, tried = config.policy_steps, config.real_episodes, config.tried_episodes
    schedule = SCHEDULES["fast"](steps, real, tried, many_searches=True)
    return replace(QUICK, search=few, schedule=replace(schedule, searches=(1, 1)))


def train_slowly(out: Path, rounds: int) -> dict:
    """A checkpoint after every round; the same to the last bit in every process."""
    with short_episodes():
        return train(config_of(out, rounds), settings=replace(QUICK, checkpoint_every_s=0.0))


if __name__ == "__main__":
    torch.set_num_threads(1)
    train_slowly(Path(sys.argv[1]), int(sys.argv[2]))
