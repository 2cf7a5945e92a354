"""What a policy on pixels loses against its teacher: students alone, of one finished run's teacher.

Trainings of two seeds have two teachers; here every student has the same one, and each way of
learning to see learns from as many episodes. The last line is one JSON object.
"""

import json
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
import tyro
from common import machine

from simtune.agents import AgentSpec, Observation
from simtune.agents.student import StudentConfig
from simtune.agents.teacher_student import TeacherStudent
from simtune.agents.teaching_schedule import TeacherStudentConfig
from simtune.evaluation.evaluate import load_trained
from simtune.experiment.settings import Settings
from simtune.experiment.training_experiment import TrainingExperiment
from simtune.randomization import Distribution
from simtune.vision.detector import DetectorConfig

_USUAL = TeacherStudentConfig()
_NO_ROWS = replace(_USUAL, student=StudentConfig(detector=DetectorConfig()))
_MOST = replace(_NO_ROWS, detector_updates_per_step=(_USUAL.detector_updates_per_step[1],) * 2)
_KINDS = {
    "as it is": _USUAL,
    "without rows": _NO_ROWS,
    "without rows, most updates": _MOST,
}


def pupil(
    run: Path, config: TeacherStudentConfig, seed: int
) -> tuple[TrainingExperiment, TeacherStudent]:
    """A run, and an agent with its teacher and a student that has learnt nothing."""
    specs: list[AgentSpec] = []

    def make_agent(_: str, spec: AgentSpec) -> TeacherStudent:
        specs.append(spec)
        return TeacherStudent(spec)

    trained = load_trained(run, Settings(make_agent=make_agent))
    agent = TeacherStudent(replace(specs[0], seed=seed), config)
    assert isinstance(trained.agent, TeacherStudent), "made above"
    agent.teacher.load_state_dict(trained.agent.teacher.state_dict())
    return trained, agent


def taught(trained: TrainingExperiment, agent: TeacherStudent, range_: float, seed: int) -> float:
    """Let the agent's student learn, as in the run, but its teacher no more; seconds of CPU."""
    assert trained.truth is not None, "of a pseudo-real world"
    worlds = Distribution.proportional(trained.space, trained.truth.for_oracle(), range_)
    rng, start = np.random.default_rng(seed), time.process_time()
    num_worlds = trained.schedule.num_worlds
    num_steps = num_worlds * trained.task.episode_steps
    while agent.num_steps < trained.schedule.total_steps:
        if agent.wants_frames:
            drawn = worlds.sample(num_worlds, rng)
            trained.replay.add(trained.learnt_in.play(agent.explore, drawn, rng, True, 0))
            agent.update(trained.replay, num_steps)
        else:  # the teacher's turn
            agent.num_steps += num_steps
    return time.process_time() - start


def returns(trained: TrainingExperiment, agent: TeacherStudent, num: int) -> tuple[float, float]:
    """The teacher's and its student's mean return in the true world."""

    def teach(observation: Observation) -> np.ndarray:
        return agent.teacher.act(torch.from_numpy(observation.state)).numpy()

    assert trained.truth is not None, "of a pseudo-real world"
    world = trained.truth.for_oracle()
    worlds, rng = np.tile(world, (num, 1)), np.random.default_rng(99)
    shown = trained.learnt_in.play(teach, worlds, rng, False, 0).rewards.sum(1)
    scores, _ = replace(trained, agent=agent).score(world, num, seed=99)
    return float(shown.mean()), float(scores["return"].mean())


def measured(run: Path, seed: int, kind: str, range_: float, num: int) -> dict[str, Any]:
    """One student's figures."""
    trained, agent = pupil(run, _KINDS[kind], seed)
    cpu_s = round(taught(trained, agent, range_, seed))
    teacher, student = (round(earned, 1) for earned in returns(trained, agent, num))
    print(f"{kind}, seed {seed}: {student:.0f} of {teacher:.0f}, {cpu_s} s", file=sys.stderr)
    return {"kind": kind, "seed": seed, "teacher": teacher, "student": student, "cpu_s": cpu_s}


def main(
    run: Path | None = None,
    seeds: tuple[int, ...] = (0, 1),
    range_policy: float = 0.02,
    episodes: int = 32,
    quick: bool = False,
) -> None:
    """Measure it: six to ten minutes of a core for each of three kinds and each seed.

    Args:
        run: A folder of `simtune train`, of a pseudo-real world without a gap.
        seeds: Of the students.
        range_policy: Half-width of the range of worlds that they learn in, around the truth.
        episodes: Of which the returns are means.
        quick: There need be no run.
    """
    if run is None and not quick:
        raise SystemExit("--run: expected a folder of simtune train, got none")
    cases = [(kind, seed) for kind in _KINDS for seed in seeds]
    rows = [measured(run, seed, kind, range_policy, episodes) for kind, seed in cases if run]
    print(json.dumps({"students": rows, **machine()}))


if __name__ == "__main__":
    tyro.cli(main)
