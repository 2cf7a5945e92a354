"""`train`: Algorithm 1 in its order, what it writes, and that a kill loses nothing."""

import dataclasses
import json
import random
import shutil
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pytest
import torch
from other_keypoints import find_others
from places import SUPPORT
from short_training import STEPS, WORLDS, by_few_windows, config_of, train_slowly

import simtune
from simtune.agents import AGENTS, Agent, AgentSpec, Observation, make_agent
from simtune.agents.curl_sac import CurlSac, CurlSacConfig
from simtune.algorithm import Training, train
from simtune.config import EvaluateConfig, TuneConfig
from simtune.errors import InputError
from simtune.evaluation.evaluate import (
    _check_unchanged,
    _what_would_make_one,
    evaluate,
    load_trained,
)
from simtune.experiment.rollout import PolicyWorlds
from simtune.experiment.run import Run
from simtune.experiment.schedule import Schedule, fast, paper
from simtune.experiment.search_settings import choose_search_settings
from simtune.experiment.settings import Settings
from simtune.experiment.training_experiment import TrainingExperiment, build_training
from simtune.randomization import Distribution
from simtune.real.gap import RealityGap
from simtune.real.recorded import RecordedReal
from simtune.real.truth import Truth
from simtune.recordings import write_dataset
from simtune.replay_buffer import ReplayBuffer
from simtune.run.checkpoint import load, newest
from simtune.run.files import read_json, read_jsonl
from simtune.search_param_model.paper import PaperConfig
from simtune.simulation import scale_actions
from simtune.tasks import TASKS, load_task
from simtune.tuning.estimate import Estimate, unsure
from simtune.tuning.search import Round
from simtune.verdicts import Verdict
from simtune.vision.keypoints import Keypoints, find_keypoints

TASK = load_task("cartpole")
SPACE = TASK.parameters
ROUNDS = 4


@pytest.fixture(scope="module")
def autotuned(tmp_path_factory, quick_settings) -> tuple[Path, dict]:
    """A finished training's folder, with a checkpoint of every round, and its result."""
    out = tmp_path_factory.mktemp("autotuned") / "run"
    return out, train_slowly(out, ROUNDS)


# --- the order of Algorithm 1 -------------------------------------------------------------


class Players:
    """Fakes of all parts, which note down what is asked of them."""

    def __init__(self):
        self.calls: list[str] = []
        self.wants_frames = True
        self.can_act = False
        self.stop_reason = ""
        self.device, self.step_s = torch.device("cpu"), TASK.step_s
        self.simulator = SimpleNamespace(num_steps=0, num_diverged=0)
        self.distribution = Distribution.proportional(SPACE, SPACE.nominal, 0.5)
        self.seen_worlds: list[np.ndarray] = []
        self.has_begun = False  # of episodes of the policy

    def collect(self, num):
        self.calls.append(f"real: {num} random")
        return ["random"] * num

    def begin_episodes(self):
        self.has_begun = True

    def run_policy(self, policy, num_stacked, num, seed, begin):
        begin()
        assert self.has_begun
        self.calls.append(f"real: {num} of the policy")
        return ["policy"] * num

    def run_round(self, real, budget):
        self.calls.append(f"search in {len(real)}, the latest of a {real[0]}")
        mean = 1.1 * self.distribution.mean
        self.distribution = Distribution.proportional(SPACE, SPACE.clip(mean), 0.5)
        return Round(unsure(self.distribution, "weak"), [], {})

    def play(self, policy, parameters, rng, film, delay_steps):
        self.calls.append("play")
        self.seen_worlds.append(parameters)
        return SimpleNamespace(rewards=np.zeros((len(parameters), STEPS)))

    def add(self, episodes):
        self.calls.append("store")

    def update(self, replay, num_steps):
        self.calls.append(f"learn from {num_steps}")
        self.can_act = True
        return {}

    def explore(self, seen, replay):
        raise AssertionError("nothing is played here")


def carried_out(players: Players, path: Path, pretrain_steps: int = 0, **asked_for) -> Training:
    """Algorithm 1 by fakes: two cycles, of two and one policy phases in three worlds."""
    schedule = Schedule(
        pretrain_steps=pretrain_steps,
        policy_steps=(2 * STEPS * 3, STEPS * 3),
        searches=(2, 1),
        real_episodes=(4, 1),
        num_worlds=3,
        image_size=16,
    )
    experiment = SimpleNamespace(
        config=config_of(path / "run", **asked_for),
        settings=Settings(),
        run_config={},
        sources=[],
        task=dataclasses.replace(TASK, episode_steps=STEPS),
        simulator=players.simulator,
        space=SPACE,
        schedule=schedule,
        real=players,
        search=players,
        agent=players,
        learnt_in=players,
        replay=players,
        start=SPACE.nominal,
        truth=None,
        search_name="posterior",
        delay_steps=lambda estimated, rng: 0,
        tensors=dict,
        state=dict,
    )
    with pytest.MonkeyPatch.context() as patch, Run(experiment) as run:
        patch.setattr("simtune.algorithm.write_real", lambda *_: None)
        training = Training(experiment, run)
        training.carry_out()
    return training


def moved(times: int) -> np.ndarray:
    """Where the fakes' search is after so many moves."""
    mean = SPACE.nominal
    for _ in range(times):
        mean = SPACE.clip(1.1 * mean)
    return mean


def test_the_order_of_calls_is_that_of_algorithm_1(tmp_path):
    players = Players()
    carried_out(players, tmp_path)
    learning = ["play", "store", f"learn from {3 * STEPS}"]
    assert players.calls == [
        "real: 4 random",
        "search in 4, the latest of a random",
        "search in 4, the latest of a random",
        *learning,
        *learning,
        "real: 1 of the policy",
        "search in 5, the latest of a policy",
        *learning,
    ]
    # The policy is trained where the search has moved to, within range_policy.
    for worlds, moves in zip(players.seen_worlds, (2, 2, 3), strict=True):
        assert (worlds <= SPACE.clip(moved(moves) * 1.1) + 1e-12).all()
        assert (worlds >= moved(moves) * 0.9 - 1e-12).all()


def test_a_search_that_knows_enough_asks_for_no_more_real_episodes(tmp_path):
    players, find = Players(), Players.run_round

    def find_enough(real, budget):
        players.stop_reason = "every parameter of the motion is known to 5 %"
        return find(players, real, budget)

    players.run_round = find_enough
    training = carried_out(players, tmp_path)
    learning = ["play", "store", f"learn from {3 * STEPS}"]
    search = "search in 4, the latest of a random"
    assert players.calls == ["real: 4 random", search, *learning * 3], "which are the same, or none"
    assert training.num_filmings == 2, "so a resumed run is at the same place"


def test_a_pretrained_policy_acts_in_the_first_real_episodes(tmp_path):
    players = Players()
    carried_out(players, tmp_path, pretrain_steps=STEPS * 3 * 20)
    learning = ["play", "store", f"learn from {3 * STEPS}"]
    assert players.calls == [
        *learning * 20,
        "real: 4 of the policy",
        "search in 4, the latest of a policy",
        "search in 4, the latest of a policy",
        *learning * 2,
        "real: 1 of the policy",
        "search in 5, the latest of a policy",
        *learning,
    ]
    # By domain randomisation around the start, which is wider than what comes later.
    before = np.concatenate(players.seen_worlds[:20]) / SPACE.nominal
    assert before.min() >= 0.5
    assert before.min() < 0.7
    # Where no policy can act, as in recordings, it takes what there is.
    players = Players()
    players.run_policy = lambda *_: []
    carried_out(players, tmp_path / "recordings", pretrain_steps=STEPS * 3)
    assert "real: 4 random" in players.calls


def test_the_first_worlds_are_drawn_apart_from_the_start(tmp_path):
    """Else each of their parameters would lie on that side of the start where the truth is."""
    agreed: list[bool] = []
    for seed in range(20):
        experiment = SimpleNamespace(config=config_of(tmp_path, seed=seed))
        start = Truth(SPACE, SPACE.nominal).wrong_start(seed)
        around = Distribution.proportional(SPACE, start, 0.5)
        first = around.sample(1, Training(experiment, None).rng)[0]
        is_nearer = (first > start) == (SPACE.nominal > start)
        agreed += is_nearer[start != SPACE.nominal].tolist()
    assert 0.3 < np.mean(agreed) < 0.7


def test_a_policy_that_has_not_begun_to_learn_is_not_tried_in_the_real_world(tmp_path):
    players = Players()
    players.update = lambda *_: {}  # it is still at school
    training = carried_out(players, tmp_path, pretrain_steps=3 * STEPS)
    assert [call for call in players.calls if call.startswith("real")] == ["real: 4 random"]
    assert training.num_skipped == 2


def test_a_policy_goes_on_near_what_is_identified(tmp_path):
    players, find = Players(), Players.run_round

    def find_all(real, budget):
        found = find(players, real, budget)
        sure: list[Verdict] = ["identified"] * len(SPACE)
        mean = players.distribution.mean
        return found._replace(estimate=Estimate(mean, mean, mean, sure))

    players.run_round = find_all
    carried_out(players, tmp_path)
    assert (players.seen_worlds[-1] <= SPACE.clip(moved(3) * 1.02) + 1e-12).all()
    assert (players.seen_worlds[-1] >= moved(3) * 0.98 - 1e-12).all()


# --- what is written ----------------------------------------------------------------------


@pytest.mark.slow
def test_a_training_on_recordings_scores_nothing(tmp_path, quick):
    simulator = load_task("cartpole").simulator(image_size=64)
    real = Truth(SPACE, SPACE.nominal).make_real(simulator, episode_steps=STEPS, seed=0)
    names = {"action_names": ["slide"], "robot_type": "cartpole", "task": "balance"}
    write_dataset(tmp_path / "dataset", real.collect(2), **names)
    dataset, out = str(tmp_path / "dataset"), tmp_path / "run"
    result = train(config_of(out, real=dataset, policy_steps=WORLDS * STEPS), settings=quick)
    assert result["real_episodes"] == 2
    assert result["recordings"]["steps"] == 2 * STEPS
    assert "return" not in result  # no policy can act there
    stored = read_json(out / "config.json")["config"]["recordings"]
    assert stored == {"dataset_hash": result["recordings"]["dataset_hash"]}


def test_what_recordings_show_wrong_is_told_before_training(tmp_path, monkeypatch, caplog):
    ready = SimpleNamespace(
        warnings=lambda _: ["a gap"], film_warnings=lambda: ["a mirrored film"], recordings=[]
    )
    training, told = MagicMock(), []
    training.carry_out = lambda: told.extend(record.getMessage() for record in caplog.records)
    monkeypatch.setattr("simtune.algorithm.build_training", lambda *_: ready)
    monkeypatch.setattr("simtune.algorithm.Run", MagicMock())
    monkeypatch.setattr("simtune.algorithm.Training", lambda *_: training)
    train(config_of(tmp_path / "run"))
    assert told == ["a gap", "a mirrored film"]
    assert training.finish.call_args.args[0] == told


def test_recordings_that_are_too_short_are_refused_before_anything_is_written(tmp_path):
    simulator = load_task("cartpole").simulator(image_size=32)
    real = Truth(SPACE, SPACE.nominal).make_real(simulator, episode_steps=8, seed=0)
    names = {"action_names": ["slide"], "robot_type": "cartpole", "task": "balance"}
    write_dataset(tmp_path / "dataset", real.collect(2), **names)
    with pytest.raises(InputError, match="has 8 steps; expected at least 21"):
        train(config_of(tmp_path / "run", real=str(tmp_path / "dataset")))
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    "method",
    [
        "dr",
        *(
            pytest.param(m, marks=pytest.mark.thorough)
            for m in ("autotune", "regression", "untuned", "oracle")
        ),
    ],
)
def test_a_finished_training_has_the_files_and_fields_that_are_documented(
    method, tmp_path, quick, request
):
    out = tmp_path / "run"
    config, settings = config_of(out, method=method), quick
    if method == "regression":  # a few small steps, not forty
        settings = by_few_windows(config)
    if method == "autotune":
        out, result = request.getfixturevalue("autotuned")
    else:
        result = train(config, settings=settings)
    assert result["method"] == method
    assert result["policy_steps"] == 4 * WORLDS * STEPS
    assert set(result["return"]) == {"mean", "std", "episodes"}
    assert 0 <= result["return"]["mean"] <= STEPS * TASK.action_repeat
    assert result["return"]["episodes"] == 2
    assert result == read_json(out / "result.json")
    lines = read_jsonl(out / "metrics.jsonl")
    assert [line["step"] for line in lines] == sorted(line["step"] for line in lines)
    assert {"return/simulated", "loss/critic", "loss/imitation"} <= set(lines[-1])
    assert (out / "report.html").is_file()
    errors = [p["percent_error"] for p in result["parameters"].values()]
    if method == "oracle":
        assert max(errors) == 0
    if method in ("dr", "untuned"):  # they stay where they start
        assert all(p["mean"] == p["initial"] for p in result["parameters"].values())
    # By random actions, then by the policy; who searches nothing need not look.
    assert result["real_episodes"] == (2 + 2 if method in ("autotune", "regression") else 0)


@pytest.mark.thorough
def test_a_policy_can_be_trained_for_ones_own_model(tmp_path, quick):
    """By a reward of the user's own; the example's grows with the bob's height."""
    example = Path(__file__).parents[2] / "examples" / "cart_pendulum"
    for name in ("tune.toml", "scene.xml", "policy.py"):
        shutil.copy(example / name, tmp_path / name)
    tune, out = tmp_path / "tune.toml", tmp_path / "run"
    short = f'name = "cart_pendulum"\nepisode_steps = {STEPS}\n'
    tune.write_text(tune.read_text().replace('name = "cart_pendulum"\n', short))
    config = config_of(out, task=str(tune), method="dr", policy_steps=3 * WORLDS * STEPS)
    result = train(config, settings=quick)
    assert 0 < result["return"]["mean"] < STEPS
    again = EvaluateConfig(run_folder=out, episodes=2, seed=0)
    assert evaluate(again, settings=quick) == result["return"]
    code = (tmp_path / "policy.py").read_text()
    (tmp_path / "policy.py").write_text(code.replace("/ 2", "* 50"))
    (tmp_path / "scene.xml").unlink()
    assert evaluate(again, settings=quick) == result["return"]  # by the run's own copies
    shutil.copy(example / "scene.xml", tmp_path / "scene.xml")
    with pytest.raises(InputError, match=r"a run with another content of \S+/policy.py \(its own"):
        train(config, settings=quick)
    kept = next((out / "sources").rglob("policy.py"))
    kept.write_text(code.replace("/ 2", "* 50"))
    with pytest.raises(InputError, match=r"is not what .* was trained with: bring it back"):
        evaluate(again, settings=quick)


@pytest.mark.thorough
def test_an_agent_on_pixels_alone_can_be_trained(tmp_path, quick):
    few = {"hidden_size": 8, "batch_size": 2, "random_steps": WORLDS * STEPS, "update_every": STEPS}

    def make_small(name: str, spec: AgentSpec) -> Agent:
        config = CurlSacConfig(image_size=spec.image_size, crop_size=27, **few)
        return CurlSac(spec.num_actions, config, seed=spec.seed)

    steps = 3 * WORLDS * STEPS
    config = config_of(tmp_path / "run", method="dr", agent="curl_sac", policy_steps=steps)
    result = train(config, settings=dataclasses.replace(quick, make_agent=make_small))
    assert result["warnings"] == []
    last = read_jsonl(tmp_path / "run" / "metrics.jsonl")[-1]
    assert np.isfinite(last["critic_loss"])


@pytest.mark.thorough
def test_training_ranges_are_those_asked_for(tmp_path, quick):
    def training(**changes) -> Training:
        search = None if changes["method"] == "regression" else quick.search
        settings = dataclasses.replace(quick, search=search)
        experiment = build_training(config_of(tmp_path, **changes), settings=settings)
        run = SimpleNamespace(estimate=unsure(experiment.search.distribution, "weak"))
        training = Training(experiment, run=run)
        training.num_filmings = 1
        return training

    of_methods = (
        ("dr", 0.5, 0.3, {"range_dr": 0.3}),
        ("untuned", 0.5, 0.0, {}),
        ("oracle", 1, 0.0, {}),
        ("autotune", 0.5, 0.02, {"range_policy": 0.02}),
    )
    for method, around, half, ranges in of_methods:
        found = training(method=method, **ranges)
        mean = SPACE.nominal if around == 1 else found.experiment.start
        assert (np.abs(mean / SPACE.nominal - 1) > 0.2).any() == (around != 1)
        distribution = found.distribution_policy
        np.testing.assert_allclose(distribution.low, SPACE.clip((1 - half) * mean))
        np.testing.assert_allclose(distribution.high, SPACE.clip((1 + half) * mean))
    pretraining = training(method="autotune", pretrain_steps=STEPS, range_dr=0.3)
    pretraining.num_filmings = 0
    start = pretraining.experiment.start
    np.testing.assert_allclose(pretraining.distribution_policy.low, SPACE.clip(0.7 * start))
    of_regression = training(method="regression", range_spm=0.4, step_size=0.07)
    config = of_regression.experiment.search.config
    assert (config.step_size, config.range_spm) == (0.07, 0.4)


@pytest.mark.thorough
def test_scored_episodes_start_elsewhere_than_all_others(tmp_path, monkeypatch):
    """Every episode begins elsewhere: looked at, tried out, scored."""
    short = dataclasses.replace(load_task("ball_in_cup"), episode_steps=STEPS)
    monkeypatch.setitem(TASKS, "ball_in_cup", lambda: short)
    config = config_of(tmp_path, task="ball_in_cup", method="oracle")
    experiment = build_training(config)
    scored = []

    def play(*args, play=experiment.learnt_in.play, **options):
        scored.append(play(*args, **options))
        return scored[-1]

    experiment.learnt_in.play = play
    experiment.score(experiment.space.nominal, 3, seed=config.seed)
    still = np.zeros((2, experiment.simulator.num_actions))
    seen = experiment.real.collect(3)
    for cycle in (0, 1):
        seen += experiment.real.run_policy(lambda frames: still, 3, 2, cycle)
    first = [*scored[0].frames[:, 0], *(trajectory.frames[0] for trajectory in seen)]
    assert len({frame.tobytes() for frame in first}) == 3 + 3 + 4


def test_a_scored_world_that_diverges_is_charged_as_in_training_which_forgets_scores(monkeypatch):
    """With the reality gap, and without."""
    task = dataclasses.replace(load_task("cheetah"), episode_steps=6)
    learnt_in, elsewhere = (
        PolicyWorlds(task, task.simulator(image_size=16), num_stacked=1) for _ in range(2)
    )
    learnt_in.load({"lowest_reward": -2.0})
    begun: list[None] = []
    ones = SimpleNamespace(
        act=lambda frames: np.ones((len(frames), 6)), begin_episodes=lambda: begun.append(None)
    )
    for scored_in in (learnt_in, elsewhere):
        simulator = scored_in.simulator

        def play(*args, play=simulator.play, **options):
            return dataclasses.replace(play(*args, **options), lengths=np.array([3]))

        given = {"learnt_in": learnt_in, "scored_in": scored_in, "late_steps": 0}
        experiment = SimpleNamespace(**given, agent=ones, task=task)
        nominal = task.parameters.nominal
        whole, _ = TrainingExperiment.score(experiment, nominal, 1, seed=0)
        monkeypatch.setattr(simulator, "play", play)
        scores, _ = TrainingExperiment.score(experiment, nominal, 1, seed=0)
        # Half of the steps, and the lowest reward for each of the others
        assert scores["return"][0] == pytest.approx(whole["return"][0] / 2 - 3 * 2.0, abs=0.5)
        assert learnt_in.state() == {"lowest_reward": -2.0}
        assert simulator.num_steps == 0  # simulated steps that something was learnt of
        monkeypatch.setattr(scored_in, "_reward", lambda batch: np.full(1, -3.0))
        scores, _ = TrainingExperiment.score(experiment, nominal, 1, seed=0)
        repeated = -3.0 * task.action_repeat
        assert scores["return"][0] == pytest.approx(6 * repeated)
        assert learnt_in.state() == {"lowest_reward": -2.0}
    assert len(begun) == 6  # for an agent that remembers what it did before


def test_a_training_of_an_earlier_version_is_refused_in_one_line():
    experiment = SimpleNamespace(config=SimpleNamespace(out=Path("runs/old")))
    with pytest.raises(InputError, match="runs/old holds a training of an earlier version of"):
        TrainingExperiment.load_agent(experiment, {}, {"agent": {}})


def test_a_run_without_a_policy_is_told_to_go_on_only_if_it_is_not_finished(tmp_path):
    assert "the same command goes on" in _what_would_make_one(tmp_path)
    (tmp_path / "result.json").touch()
    said = _what_would_make_one(tmp_path)
    assert "go on" not in said
    assert "train anew with more --policy-steps" in said


@pytest.mark.thorough
def test_a_loaded_policy_is_scored_by_the_lowest_reward_of_its_training(
    autotuned, quick, monkeypatch
):
    out, _ = autotuned
    tensors, state = load(newest(out / "checkpoints"))
    stored = tensors, state | {"policy_worlds": {"lowest_reward": -3.0}}
    monkeypatch.setattr("simtune.evaluation.evaluate.checkpoint.load", lambda _: stored)
    assert load_trained(out, settings=quick).learnt_in.state() == {"lowest_reward": -3.0}


@pytest.mark.thorough
def test_all_recordings_are_taken_where_no_number_is_asked_for(tmp_path, quick):
    simulator = load_task("cartpole").simulator(image_size=64)
    real = Truth(SPACE, SPACE.nominal).make_real(simulator, episode_steps=STEPS, seed=0)
    names = {"action_names": ["slide"], "robot_type": "cartpole", "task": "balance"}
    write_dataset(tmp_path / "dataset", real.collect(3), **names)
    config = config_of(tmp_path / "run", real=str(tmp_path / "dataset"), real_episodes=None)
    assert build_training(config, settings=quick).schedule.real_episodes == (3, 2)
    with pytest.raises(InputError, match="5 episodes asked for, it holds 3; ask for 1 to 3"):
        build_training(dataclasses.replace(config, real_episodes=5), settings=quick)


def test_a_policy_that_begins_to_learn_too_late_gives_a_warning(tmp_path, quick):
    experiment = build_training(config_of(tmp_path, method="dr"), settings=quick)
    too_few = "the policy had not begun to learn: give more --policy-steps"
    assert experiment.policy_warnings(0) == [too_few]
    ready = dataclasses.replace(experiment, agent=SimpleNamespace(can_act=True))
    assert ready.policy_warnings(0) == []
    assert "when the real world was to see it" in ready.policy_warnings(1)[0]
    of_recordings = RecordedReal(SimpleNamespace(step_s=0.05))  # where no policy can act
    assert dataclasses.replace(ready, real=of_recordings).policy_warnings(1) == []


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"policy_steps": 0}, "--policy-steps must be at least 1"),
        ({"range_dr": 0.0}, r"--range-dr must lie in \(0, 1\], got 0"),
        ({"start_factor": 0.5}, "--start-factor must be at least 1, got 0.5"),
        ({"scored_episodes": 0}, "--scored-episodes must be at least 1"),
        ({"method": "oracle", "real": "somewhere"}, "--method oracle needs --real pseudo"),
        ({"method": "dr", "search": "paper"}, "--search goes with --method autotune only"),
        ({"method": "dr", "step_size": 0.3}, "--step-size goes with --search paper or"),
        ({"window": 5}, "--window goes with --search paper or --method regression"),
        ({"method": "dr", "real_episodes": 3}, "--real-episodes goes with --method autotune or re"),
        ({"method": "oracle", "tried_episodes": 0}, "--tried-episodes goes with --method autotune"),
        ({"method": "dr", "range_policy": 0.2}, "--range-policy goes with --method autotune or r"),
        ({"method": "oracle", "range_dr": 0.2}, "--range-dr goes with --method dr or --pretrain-"),
        ({"range_dr": 0.2}, "--range-dr goes with --method dr or --pretrain-steps"),
        ({"real": "film", "scored_episodes": 5}, "--scored-episodes goes with --real pseudo only"),
        ({"real": "film", "tried_episodes": 1}, "--tried-episodes goes with --real pseudo or a ro"),
        ({"method": "dr", "known_colour": "pole"}, "--known-colour .* --search posterior, got dr"),
        ({"preset": "paper", "known_colour": "pole"}, "--known-colour .* posterior, got paper"),
        (
            {"device": "cuda:99"},
            "cuda:99 cannot be used here: .*; give --device cpu or auto$",
        ),
        ({"task": "cartpol"}, "did you mean 'cartpole'"),
        ({"method": "regression", "window": 250}, "--window must be at most an episode's"),
    ],
)
def test_wrong_input_is_refused_and_nothing_is_written(changes, message, tmp_path):
    out = tmp_path / "run"
    with pytest.raises(InputError, match=message):
        train(config_of(out, **changes))
    assert not out.exists()


@pytest.mark.thorough
@pytest.mark.parametrize("task", ["cartpole", "rope_peg"])
def test_a_search_simulates_episodes_as_long_as_the_real_ones(task, tmp_path):
    config = config_of(tmp_path / "run", task=task, method="regression", real_parameters=None)
    search = build_training(config).search
    assert search.config.episode_steps == load_task(task).episode_steps


@pytest.mark.thorough
def test_schedules_of_the_presets_equal_hand_calculation(tmp_path):
    """By hand: what is tried out when, and the paper's phases in its own numbers."""
    assert fast(48_000, 5, many_searches=False).steps_before_trial == 24_000
    assert fast(48_000, 5, pretrain_steps=16_000, many_searches=False).steps_before_trial == 16_000
    assert fast(48_000, 5, many_searches=False).real_episodes == (5, 2)
    assert fast(48_000, 5, 0, many_searches=False).real_episodes == (5, 0)
    assert paper(120_000, 5, many_searches=True).real_episodes == (5, 5, 5)
    assert paper(120_000, 5, 1, many_searches=True).real_episodes == (5, 1, 1)
    config = config_of(tmp_path, preset="paper", policy_steps=None)
    experiment = build_training(config)
    assert experiment.schedule.total_steps == pytest.approx(500_000, abs=50)
    assert len(experiment.schedule.policy_steps) == 12  # 40k steps each, about
    search = experiment.search.config
    assert search.collect_steps == search.pretrain_steps == 50_000
    # The first call collects as well; rounds that do not move come first, then 40 that do.
    steps_per_call = search.episodes_per_iteration * search.episode_steps
    assert experiment.schedule.searches[0] == 50_000 / steps_per_call + 40
    short = build_training(dataclasses.replace(config, task="rope_peg")).search.config
    assert short.episode_steps == 60
    assert short.episodes_per_iteration * short.episode_steps == pytest.approx(2000, rel=0.02)


def test_the_papers_search_has_crops_room_and_moves_for_what_is_planned(tmp_path):
    long = config_of(tmp_path, preset="paper", policy_steps=1_000_000)
    search = choose_search_settings(long, "paper", load_task("rope_peg"), [], 100)
    assert isinstance(search, PaperConfig)
    assert search.max_moves == 65 + 24 * 5  # rounds of 25 cycles, all but 25 of which move
    assert search.num_kept == 834  # 50,000 steps of 60 an episode
    assert search.crop_size == 84
    tuning = TuneConfig(task="cartpole", out=tmp_path)
    for image_size, expected in ((32, 27), (64, 54), (100, 84), (128, 84)):
        search = choose_search_settings(tuning, "regression", TASK, [], image_size)
        assert isinstance(search, PaperConfig)
        assert (search.crop_size, search.max_moves) == (expected, 100)


@pytest.mark.thorough
def test_a_real_world_with_changed_parameters_is_refused(tmp_path, quick):
    truth = tmp_path / "real.json"
    truth.write_text('{"body_r": 0.6}')  # twice or half of either is 1, or hardly differs
    config = config_of(tmp_path / "run", method="dr", real_parameters=truth)
    train(config, settings=quick)
    scores = evaluate(EvaluateConfig(run_folder=config.out, episodes=2), settings=quick)
    truth.write_text('{"body_r": 0.8}')
    assert evaluate(EvaluateConfig(run_folder=config.out, episodes=2), settings=quick) == scores
    with pytest.raises(InputError, match="other values in --real-parameters"):
        train(config, settings=quick)
    next((config.out / "sources").rglob("real.json")).write_text('{"body_r": 0.8}')
    with pytest.raises(InputError, match="has other values now"):
        evaluate(EvaluateConfig(run_folder=config.out, episodes=2), settings=quick)


def test_a_task_that_other_versions_read_otherwise_names_them(tmp_path):
    task = SimpleNamespace(content_hash="5a", policy_hash=None)
    config = {"task": "cartpole", "task_content": "4f", "policy_content": None}
    stored = {"config": config, "versions": {"mujoco": "3.0.0"}}
    with pytest.raises(InputError, match=r"^cartpole is read .* \(mujoco 3.0.0 → \S+\): go "):
        _check_unchanged(SimpleNamespace(truth=None, task=task), stored, tmp_path)


# --- killed and resumed -------------------------------------------------------------------


def without_time(lines: list[dict]) -> list[dict]:
    return [{k: v for k, v in line.items() if k != "wall_s"} for line in lines]


def assert_same(one: Path, other: Path) -> None:
    """The same results, metrics, and every bit of the last checkpoint."""
    for name in ("metrics.jsonl", "events.jsonl"):
        assert without_time(read_jsonl(one / name)) == without_time(read_jsonl(other / name))
    results = [{k: v for k, v in read_json(p / "result.json").items()} for p in (one, other)]
    for result in results:
        del result["wall_s"]
    assert results[0] == results[1]
    (tensors, state), (others, other_state) = (
        load(newest(p / "checkpoints")) for p in (one, other)
    )
    assert tensors.keys() == others.keys()
    for name, tensor in tensors.items():
        torch.testing.assert_close(tensor, others[name], rtol=0, atol=0, equal_nan=True, msg=name)
    for changing in (state, other_state):
        del changing["wall_s"]
    assert state == other_state


@pytest.mark.thorough
def test_a_stopped_run_resumes_to_the_same_result(autotuned, tmp_path, quick):
    settings = dataclasses.replace(quick, checkpoint_every_s=0.0)
    interrupted_at = []

    def interrupt(doing: str, done: float) -> None:
        if doing == "training the policy" and len(interrupted_at) < 4:
            interrupted_at.append(done)
            if len(interrupted_at) % 2 == 0:
                raise KeyboardInterrupt

    out = tmp_path / "stopped"
    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            train(config_of(out), interrupt, settings)
    train(config_of(out), interrupt, settings)
    assert_same(autotuned[0], out)

    # And what `evaluate` makes of it, from the checkpoint alone: on the same episodes the same.
    again = evaluate(
        EvaluateConfig(run_folder=out, episodes=2, seed=config_of(out).seed), settings=quick
    )
    assert again == read_json(out / "result.json")["return"]
    with pytest.raises(InputError, match=r"is no folder that `simtune train` wrote"):
        evaluate(EvaluateConfig(run_folder=tmp_path / "nowhere"), settings=quick)


@pytest.mark.thorough
def test_a_training_of_a_robot_is_loaded_without_asking_the_robot(tmp_path, quick, monkeypatch):
    """One that was made behind the gap, which a camera films as well, stands for it."""
    drawn = staticmethod(lambda task, views: task.simulator(image_size=64, views=views))
    monkeypatch.setattr(RealityGap, "simulator", drawn)
    out = tmp_path / "run"
    settings = dataclasses.replace(quick, search=dataclasses.replace(quick.search, num_rounds=1))
    train(config_of(out, real_gap=True, real_episodes=1), settings=settings)
    stored = read_json(out / "config.json")
    stored["config"] |= {"real": "xarm", "robot": "gone.toml", "truth": None, "real_gap": False}
    del stored["config"]["range_policy"]  # as if the run's version had not had it
    (out / "config.json").write_text(json.dumps(stored))
    trained = load_trained(out, settings=settings)
    assert trained.agent.can_act
    assert trained.simulator.step_s == TASK.step_s
    assert trained.simulator.supersampling == 2  # as for what a camera films
    assert trained.truth is None
    _, state = load(newest(out / "checkpoints"))
    found = Estimate.from_json(state["estimate"])
    late = found.late_steps(TASK.step_s)
    assert trained.late_steps == max(0, round(late))
    with monkeypatch.context() as patch:
        patch.setattr(TrainingExperiment, "declared_late_steps", 1.0)  # by the camera's latency_s
        later = load_trained(out, settings=settings)
    assert later.late_steps == min(max(0, round(late + 1)), later.learnt_in.max_delay_steps)
    with pytest.raises(InputError, match="is of the real world, where no return is known"):
        evaluate(EvaluateConfig(run_folder=out), settings=settings)
    (tmp_path / "world.json").write_text("{}")
    world = EvaluateConfig(run_folder=out, parameters=tmp_path / "world.json", episodes=2, seed=0)
    assert evaluate(world, settings=settings)["mean"] > 0


@pytest.mark.thorough
def test_a_policy_acts_in_a_loop_of_ones_own_as_where_it_was_scored(autotuned, quick, monkeypatch):
    out, _ = autotuned
    monkeypatch.setattr("simtune.api.policy.load_trained", partial(load_trained, settings=quick))
    policy, trained = simtune.load(out).policy(), load_trained(out, settings=quick)
    seen, actions, act = [], [], trained.agent.act

    def spy(frames: np.ndarray) -> np.ndarray:
        seen.append(frames[0, -1])
        actions.append(act(frames))
        return actions[-1]

    trained.agent.act = spy
    assert trained.truth is not None
    trained.score(trained.truth.for_oracle(), 1, seed=0)
    for _ in range(2):
        policy.reset()
        wide = [np.pad(picture, ((0, 0), (9, 9), (0, 0))) for picture in seen]
        acted = [policy.act(picture) for picture in wide]
        expected = scale_actions(TASK.load_actions(), np.concatenate(actions))
        np.testing.assert_allclose(acted, expected, rtol=1e-5)
    assert policy.step_s == TASK.step_s
    assert policy.action_names == ("slide",)
    with pytest.raises(ValueError, match=r"expected a picture \(H, W, 3\) uint8, got \(8, 8\)"):
        policy.act(np.zeros((8, 8), np.uint8))
    with pytest.raises(ValueError, match="the picture is upright"):
        policy.act(np.zeros((9, 8, 3), np.uint8))


def test_keypoints_are_chosen_once_for_search_environment_and_agent(tmp_path, quick, monkeypatch):
    seeds, num_keypoints = [], []

    def find(simulator, distribution, seed, points) -> Keypoints:
        """Another seed may choose others; each but 0 does here."""
        seeds.append(seed)
        choose = find_others if seed else find_keypoints
        return choose(simulator, distribution, seed, points)

    def make_agent(name: str, spec: AgentSpec) -> Agent:
        num_keypoints.append(spec.num_keypoints)
        return quick.make_agent(name, spec)

    monkeypatch.setattr("simtune.experiment.keypoints.find_keypoints", find)
    settings = dataclasses.replace(quick, make_agent=make_agent)
    experiment = build_training(config_of(tmp_path / "run", seed=5), settings=settings)
    assert seeds == [5]
    chosen = experiment.keypoints.state()
    assert experiment.learnt_in.keypoints.state() == chosen
    assert experiment.search.context.keypoints.state() == chosen
    assert num_keypoints == [len(experiment.keypoints)]


@pytest.mark.thorough
def test_a_resumed_training_keeps_the_keypoints_it_was_begun_with(
    autotuned, tmp_path, quick, monkeypatch
):
    """Where `find_keypoints` would choose others, as it may on another machine."""
    config = config_of(shutil.copytree(autotuned[0], tmp_path / "run"))
    begun = load(newest(config.out / "checkpoints"))[1]["keypoints"]
    monkeypatch.setattr("simtune.experiment.keypoints.find_keypoints", find_others)
    new = build_training(config_of(tmp_path / "new"), settings=quick)
    assert new.learnt_in.keypoints.state() != begun
    resumed = build_training(config, settings=quick)
    with Run(resumed) as run:
        run.resume()
    for experiment in (resumed, load_trained(config.out, settings=quick)):
        assert experiment.learnt_in.keypoints.state() == begun
        assert experiment.search.context.keypoints.state() == begun


@pytest.mark.slow
@pytest.mark.parametrize("kills", [1, 50])
def test_a_run_killed_at_random_moments_loses_nothing(kills, tmp_path, autotuned):
    """SIGKILL, which nothing can catch, in a process of its own, whenever it has got on."""
    rng, rounds, straight = random.Random(0), ROUNDS * kills, autotuned[0]
    lines = 3  # once the policy has been trained, if there is one kill only
    if kills > 1:
        train_slowly(straight := tmp_path / "straight", rounds)
        lines = 1
    metrics, num_killed = tmp_path / "killed" / "metrics.jsonl", 0
    while num_killed < kills:
        script = str(SUPPORT / "short_training.py")
        command = [sys.executable, script, str(tmp_path / "killed"), str(rounds)]
        process, before = subprocess.Popen(command), len(read_jsonl(metrics))
        while process.poll() is None and len(read_jsonl(metrics)) < before + lines:
            time.sleep(0.01)
        time.sleep(rng.uniform(0, 0.2))
        process.send_signal(signal.SIGKILL)
        assert process.wait() == -signal.SIGKILL, "it was done before it could be killed"
        num_killed += 1
    train_slowly(tmp_path / "killed", rounds)
    assert_same(straight, tmp_path / "killed")


@pytest.mark.thorough
@pytest.mark.parametrize("name", AGENTS)
def test_an_agent_made_by_name_acts_and_is_stored_and_loaded(name):
    """Each acts on pictures of the size that it was made for, and can be stored and loaded."""

    def make(seed: int, total_steps: int = 100_000) -> Agent:
        spec = AgentSpec(
            image_size=64,
            num_stacked=3,
            num_keypoints=2,
            num_states=5,
            num_positions=3,
            num_actions=2,
            privileged=np.array([True, False]),
            total_steps=total_steps,
            steps_before_trial=50_000,
            steps_between_updates=3_200,
            seed=seed,
            device="cpu",
        )
        return make_agent(name, spec)

    agent, other = make(0), make(1, total_steps=1)
    assert not agent.can_act
    frames = np.random.default_rng(0).integers(0, 256, (4, 3, 64, 64, 3), dtype=np.uint8)
    replay = ReplayBuffer(SPACE, filmed_capacity=1)
    explored = agent.explore(Observation(np.zeros((4, 5), np.float32), frames), replay)
    agent.begin_episodes()
    acted = agent.act(frames)
    for actions in (explored, acted, agent.act(frames, sample=True)):
        assert actions.shape == (4, 2)
        assert (np.abs(actions) <= 1).all()
    other.load({k: v.clone() for k, v in agent.tensors().items()}, agent.state())
    np.testing.assert_array_equal(other.act(frames), acted)
