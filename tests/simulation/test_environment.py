"""A simulator that is not MuJoCo: played, drawn, seen and tuned like one that is."""

import importlib.util
import json
import math
import shutil
from dataclasses import replace
from pathlib import Path

import gymnasium
import numpy as np
import pytest

from simtune.algorithm import train
from simtune.checking import check
from simtune.config import CheckConfig, RecordConfig, TrainConfig, TuneConfig
from simtune.errors import InputError
from simtune.experiment.experiment import build_experiment
from simtune.filming import record
from simtune.observation import ObservationModel
from simtune.randomization import Distribution
from simtune.recordings import write_dataset
from simtune.run.files import read_json
from simtune.search_param_model.simulated import play_worlds
from simtune.simulation import EnvironmentSimulator, random_actions
from simtune.tasks import load_any_task
from simtune.trajectory import Trajectory
from simtune.tuning.pace import Work
from simtune.tuning_run import tune
from simtune.vision.keypoints import find_keypoints

EXAMPLE = Path(__file__).parents[2] / "examples" / "bouncing_ball"
FILE = str(EXAMPLE / "tune.toml")
TASK = load_any_task(FILE)
SPACE = TASK.parameters
SIZE = 48


@pytest.fixture(scope="module")
def ball():
    """The example's module."""
    spec = importlib.util.spec_from_file_location("env", EXAMPLE / "env.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def some_worlds(n: int, steps: int, seed: int = 0):
    rng = np.random.default_rng(seed)
    parameters = Distribution.first(SPACE, SPACE.nominal).sample(n, rng)
    return parameters, rng.uniform(-1, 1, (n, steps, 1)), rng


# --- played and drawn ---------------------------------------------------------------------


def test_pictures_are_those_that_the_environment_draws_on_the_way(ball):
    simulator = TASK.simulator(image_size=96)
    parameters, actions, rng = some_worlds(3, 12)
    seeds = np.random.default_rng(7).integers(2**31, size=3)
    rollouts = simulator.roll_out(parameters, actions, np.random.default_rng(7))
    assert rollouts.states.shape == (3, 13, 2)
    films = simulator.film(rollouts)
    for i in range(3):
        env = ball.BouncingBall()
        world = dict(zip(SPACE.names, parameters[i].tolist(), strict=True))
        env.reset(seed=int(seeds[i]), options={"parameters": world})
        for t in range(13):
            np.testing.assert_array_equal(films[i, t], env.render())
            if t < 12:
                env.step(actions[i, t].astype(np.float32))
    # And in any order, some of them alone.
    order = rng.permutation(39)[:10]
    every = rollouts.states.reshape(39, 2), np.repeat(parameters, 13, axis=0)
    drawn = simulator.render(every[0][order], every[1][order])
    np.testing.assert_array_equal(drawn, films.reshape(39, 96, 96, 3)[order])
    assert simulator.num_steps == 36


def test_a_start_is_that_of_another_episode_whatever_the_world():
    simulator = TASK.simulator(image_size=SIZE)
    parameters, actions, rng = some_worlds(2, 3)
    first = simulator.roll_out(parameters[:1], actions[:1], rng)
    changed = parameters[1:].copy()
    changed[:, [p.is_visible for p in SPACE]] = parameters[0, [p.is_visible for p in SPACE]]
    second = simulator.roll_out(changed, actions[1:], rng, starts=first.states[:, 0])
    one, other = simulator.film(first)[0], simulator.film(second)[0]
    np.testing.assert_array_equal(one[0], other[0])
    assert (one[-1] != other[-1]).any()


def test_old_episodes_are_forgotten_and_the_latest_are_not(monkeypatch):
    monkeypatch.setattr("simtune.simulation.environment._MOST_ACTIONS_KEPT", 20)
    simulator = TASK.simulator(image_size=SIZE)
    parameters, actions, rng = some_worlds(3, 5)
    first = simulator.roll_out(parameters, actions, rng)
    second = simulator.roll_out(parameters, actions, rng)
    assert [played.states[-1, 0, 0] for played in (first, second)] == [2, 5]
    assert len(simulator._episodes) == 4
    assert simulator.film(second).shape[:2] == (3, 6)
    with pytest.raises(ValueError, match="episode 0 can no longer be drawn"):
        simulator.film(first)
    many = simulator.roll_out(np.repeat(parameters, 3, 0), np.repeat(actions, 3, 0), rng)
    assert simulator.film(many).shape[:2] == (9, 6)  # all of one call stay


class Letterbox(gymnasium.Wrapper):
    """Grey bars beside the picture, or above and below: half as much again."""

    def __init__(self, env, axis: int):
        super().__init__(env)
        self._axis = axis

    def _told(self, info):
        points = np.array(info["points"])
        points[:, 1 - self._axis] = (points[:, 1 - self._axis] + 0.25) / 1.5
        return {"points": points}

    def reset(self, **options):
        seen, info = self.env.reset(**options)
        return seen, self._told(info)

    def step(self, action):
        *rest, info = self.env.step(action)
        return (*rest, self._told(info))

    def render(self):
        picture = self.env.render()
        wide = [(0, 0), (0, 0), (0, 0)]
        wide[self._axis] = (len(picture) // 4,) * 2
        return np.pad(picture, wide, constant_values=128)


@pytest.mark.parametrize("axis", [0, 1])
def test_pictures_that_are_not_square_are_cut_to_their_middle(ball, axis):
    parameters, actions, _ = some_worlds(2, 6)
    plain, boxed = (
        EnvironmentSimulator(env, SPACE, step_s=0.05, image_size=SIZE)
        for env in (ball.BouncingBall(), Letterbox(ball.BouncingBall(), axis))
    )
    seen = []
    for simulator in (plain, boxed):
        rng, points = np.random.default_rng(3), simulator.points()
        rollouts = simulator.roll_out(parameters, actions, rng, points.observe)
        seen.append((simulator.film(rollouts), rollouts.observed))
    np.testing.assert_array_equal(seen[0][0], seen[1][0])
    np.testing.assert_allclose(seen[0][1], seen[1][1], atol=1e-4)


def test_points_are_where_the_ball_is_in_the_picture():
    simulator = TASK.simulator(image_size=SIZE)
    parameters, actions, rng = some_worlds(4, 10)
    points = simulator.points()
    assert len(points) == 1
    rollouts = simulator.roll_out(parameters, actions, rng, points.observe)
    frames = simulator.film(rollouts).astype(float)
    walls = np.median(frames, axis=(0, 1))
    weight = np.abs(frames - walls).sum(-1) * (np.abs(frames - walls).sum(-1) > 60)
    rows, columns = np.mgrid[:SIZE, :SIZE]
    total = weight.sum((2, 3))
    seen = np.stack([(weight * columns).sum((2, 3)), (weight * rows).sum((2, 3))], -1)
    far = np.abs(seen / total[..., None] - rollouts.observed)
    assert np.median(far) < 0.3
    again = points.with_state(json.loads(json.dumps(points.state())))
    np.testing.assert_array_equal(again.chosen, points.chosen)


def test_an_environments_own_time_limit_ends_no_world(ball):
    class Limited(ball.BouncingBall):
        def step(self, action):
            *rest, info = super().step(action)
            rest[3] = True
            return (*rest, info)

    simulator = replace(TASK, make=Limited).simulator(image_size=SIZE)
    parameters, actions, rng = some_worlds(3, 10)
    assert len(simulator.roll_out(parameters, actions, rng)) == 3
    assert not simulator.num_diverged


def test_worlds_that_end_before_their_time_are_left_out(ball):
    class Mortal(ball.BouncingBall):
        def step(self, action):
            *rest, info = super().step(action)
            rest[2] = self._place[1] < 0.2
            return (*rest, info)

    simulator = replace(TASK, make=Mortal).simulator(image_size=SIZE)
    parameters, actions, rng = some_worlds(20, 20)
    rollouts = simulator.roll_out(parameters, actions, rng)
    assert 0 < len(rollouts) < 20
    assert simulator.num_diverged == 20 - len(rollouts)
    np.testing.assert_array_equal(rollouts.parameters, parameters[rollouts.index])
    assert simulator.film(rollouts).shape == (len(rollouts), 21, SIZE, SIZE, 3)


def test_worlds_of_an_environment_are_simulated_as_those_of_a_model():
    simulator = TASK.simulator(image_size=SIZE)
    first = Distribution.first(SPACE, SPACE.nominal)
    points = find_keypoints(simulator, first, seed=0)
    assert len(points) == 1
    rng = np.random.default_rng(0)
    actions = random_actions(12, 20, simulator.action_mapping, rng).reshape(6, 2, 20, 1)
    observation = ObservationModel.of_reality()
    played = play_worlds(simulator, points, first.sample(6, rng), actions, rng, observation)
    worlds = played.filmed(4, rng)
    assert worlds.frames.shape == (6, 4, SIZE, SIZE, 3)
    assert worlds.filmed_keypoints().shape == (6, 4, 1, 2)


def filmed(folder: Path, shape: tuple[int, int]) -> Path:
    """A dataset of the ball, in the middle of grey pictures of this (height, width)."""
    parameters, actions, rng = some_worlds(2, 40)
    simulator = TASK.simulator(image_size=SIZE)
    films = simulator.film(simulator.roll_out(parameters, actions, rng))
    around = [(0, 0), (0, 0), *(((long - SIZE) // 2,) * 2 for long in shape), (0, 0)]
    pictures = np.pad(films, around, constant_values=128)
    both = zip(pictures, actions.astype(np.float32), strict=True)
    episodes = [Trajectory(film, its, TASK.step_s) for film, its in both]
    write_dataset(folder, episodes, action_names=["push"], robot_type="ball", task="bounce")
    return folder


def test_of_a_wide_film_the_middle_square_is_used(tmp_path):
    film = filmed(tmp_path / "film", (SIZE, SIZE * 4 // 3))
    config = TuneConfig(task=FILE, out=tmp_path / "run", real=str(film), image_size=SIZE)
    experiment = build_experiment(config)
    first = experiment.recordings[0].frames
    assert first.shape[1:3] == experiment.simulator.shape == (SIZE, SIZE)
    assert (np.abs(first[:, :, [0, -1]].astype(int) - 128).max(-1) > 40).all(), "no grey bars"


def test_work_of_an_environment_is_known_as_such():
    trajectory = Trajectory(np.zeros((3, 8, 8, 3), np.uint8), np.zeros((2, 1), np.float32), 0.05)
    assert Work.of(TASK.simulator(image_size=SIZE), [trajectory], False).is_environment
    cartpole = load_any_task("cartpole").simulator(image_size=SIZE, views=())
    assert not Work.of(cartpole, [trajectory], False).is_environment


def test_upright_films_of_an_environment_are_refused(tmp_path):
    film = filmed(tmp_path / "film", (SIZE * 4 // 3, SIZE))
    config = TuneConfig(task=FILE, out=tmp_path / "run", real=str(film))
    with pytest.raises(InputError, match=r"upright, 48×64; .*crop it to a square"):
        tune(config)


def test_pictures_of_another_shape_than_the_simulators_are_refused_at_the_start(tmp_path):
    wide = replace(TASK, cameras=(replace(TASK.cameras[0], is_square=False),))
    film = filmed(tmp_path / "film", (SIZE, SIZE * 4 // 3))
    config = TuneConfig(task=FILE, out=tmp_path / "run", real=str(film), image_size=SIZE)
    with pytest.raises(InputError, match="come as 64×48, and the simulator draws 48×48: crop"):
        build_experiment(config, task=wide)


# --- tuned --------------------------------------------------------------------------------


@pytest.mark.thorough
def test_tune_takes_an_environment_and_resumes(tmp_path, quick):
    example = shutil.copytree(EXAMPLE, tmp_path / "example")
    file = example / "tune.toml"
    file.write_text(file.read_text().replace("episode_steps = 100", "episode_steps = 24"))
    options = {"task": str(file), "out": tmp_path / "run", "real_episodes": 2}
    config = TuneConfig(**options, budget_minutes=math.inf)
    result = tune(config, settings=quick)
    assert list(result["parameters"]) == list(SPACE.names)
    assert all("real" in entry for entry in result["parameters"].values())
    assert (config.out / "videos" / "after.mp4").is_file()
    # Its last round once more, from the checkpoint before: to the last bit the same.
    newest = max((config.out / "checkpoints").iterdir())
    for file in newest.iterdir():
        file.unlink()
    newest.rmdir()
    again = tune(config, settings=quick)
    assert read_json(config.out / "result.json")["parameters"] == result["parameters"]
    assert again["sim_steps"] == result["sim_steps"]


@pytest.mark.slow
def test_tune_finds_the_parameters_of_a_known_environment(tmp_path):
    truth = {"gravity": 7.0, "bounce": 0.75, "push": 3.0, "ball_g": 0.3}
    (tmp_path / "truth.json").write_text(json.dumps(truth))
    result = tune(
        TuneConfig(
            task=FILE,
            out=tmp_path / "run",
            real_parameters=tmp_path / "truth.json",
            budget_minutes=6,
        )
    )
    found = result["parameters"]
    assert found["gravity"]["percent_error"] < 10
    assert found["bounce"]["percent_error"] < 10
    assert found["push"]["percent_error"] < 10
    assert found["ball_g"]["percent_error"] < 6


# --- what cannot be -----------------------------------------------------------------------


def refused(text: str, folder: Path) -> str:
    """What `tune` says of a tuning file with this text."""
    (folder / "tune.toml").write_text(text)
    with pytest.raises(InputError) as error:
        tune(TuneConfig(task=str(folder / "tune.toml"), out=folder / "run"))
    assert not (folder / "run").exists()
    return str(error.value)


def test_a_file_may_have_dataclasses_and_helpers_beside_it(tmp_path):
    _, code = (EXAMPLE / "env.py").read_text().split("import gymnasium", 1)
    (tmp_path / "env.py").write_text(
        "from __future__ import annotations\n"
        "from dataclasses import dataclass\n"
        "import beside\n\n"
        "@dataclass\nclass Size:\n    width: int\n\n"
        "import gymnasium" + code
    )
    (tmp_path / "beside.py").write_text("")
    (tmp_path / "tune.toml").write_text((EXAMPLE / "tune.toml").read_text())
    assert load_any_task(str(tmp_path / "tune.toml")).simulator(image_size=32).num_actions == 1


def test_a_change_beside_the_environment_is_noticed(tmp_path):
    code = (EXAMPLE / "env.py").read_text()
    texts = {
        "env.py": f'import weights_beside\nMODEL, TABLE = "robot.xml", "table.npy"\n{code}',
        "weights_beside.py": "MASS = 1\n",
        "robot.xml": "<mujoco/>",
        "table.npy": "\x00",
        "tune.toml": (EXAMPLE / "tune.toml").read_text(),
    }
    for folder in ("a", "copy"):
        (tmp_path / folder).mkdir()
        for name, text in texts.items():
            (tmp_path / folder / name).write_text(text)

    def content(folder: str) -> str:
        return load_any_task(str(tmp_path / folder / "tune.toml")).content_hash

    seen = [content("a")]
    assert content("copy") == seen[0]  # as in a run's copies
    for name in ("weights_beside.py", "robot.xml", "table.npy"):
        (tmp_path / "a" / name).write_text(texts[name] + " ")
        seen.append(content("a"))
    assert len(set(seen)) == 4


def _needs_another_version(**_: object) -> None:
    exec("from numpy import no_such_thing", {})


def test_files_that_name_no_environment_are_refused(tmp_path):
    text = (EXAMPLE / "tune.toml").read_text()
    (tmp_path / "env.py").write_text((EXAMPLE / "env.py").read_text())
    assert "tune.toml:1: there is no file" in refused(text.replace("env.py", "enf.py"), tmp_path)
    assert "has no Ball to call" in refused(text.replace("BouncingBall", "Ball"), tmp_path)
    by_id = text.replace("env.py:BouncingBall", "NoSuchThing-v0")
    assert "gymnasium does not know NoSuchThing-v0" in refused(by_id, tmp_path)
    assert "did you mean 'nominal'" in refused(text.replace("nominal", "nominel"), tmp_path)
    assert "model" in refused('model = "a.xml"\n' + text, tmp_path)
    for name in (" ", "a, b / c"):
        renamed = text.replace('name = "gravity"', f'name = "{name}"')
        assert f"letters, digits, _ and - only, got {name!r}" in refused(renamed, tmp_path)
    (tmp_path / "env.py").write_text("import not_there_at_all")
    assert "env.py cannot be run: ModuleNotFoundError" in refused(text, tmp_path)
    (tmp_path / "env.py").write_text("class :")
    assert "env.py cannot be run: SyntaxError" in refused(text, tmp_path)
    package = f"{__name__}_package"  # of an id whose package is there, but not what it imports
    gymnasium.register("Lacking-v0", lambda **_: importlib.import_module(package))
    lacking = text.replace("env.py:BouncingBall", "Lacking-v0")
    assert f"Lacking-v0 needs the Python package {package}, which is" in refused(lacking, tmp_path)
    gymnasium.register("Older-v0", _needs_another_version)
    older = text.replace("env.py:BouncingBall", "Older-v0")
    assert "Older-v0 cannot be made: cannot import name" in refused(older, tmp_path)
    without_py = text.replace("env.py:BouncingBall", "env:BouncingBall")
    assert "gymnasium does not know env:BouncingBall" in refused(without_py, tmp_path)


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        ('{"points": [[self._place[0], 1 - self._place[1]]]}', "{}", 'info["points"]'),
        (".astype(np.uint8)", "", "uint8"),
        ("Box(-1, 1, (1,), np.float32)", "Discrete(3)", "must be a Box"),
        ("def __init__(self):", "def __init__(self, size):", "cannot be made: TypeError"),
        (
            "def __init__(self):",
            "def __new__(cls):\n        return []\n\n    def __init__(self):",
            "expected a gymnasium.Env, got one without action_space: []",
        ),
        ("seed=None, options=None", "seed=None", "environment's reset() failed: TypeError"),
        ("0.0, False, False,", "0.0, False,", "environment's step() failed: ValueError"),
        ("        away =", "        1 / 0\n        away =", "render() failed: ZeroDivisionError"),
        (
            "        away =",
            '        raise RuntimeError("an OpenGL platform library has not been loaded")\n'
            "        away =",
            "needs MUJOCO_GL=egl",
        ),
        ("1 - self._place[1]]", "np.nan]", 'info["points"] must be (L, 2) finite'),
        ("1 - self._place[1]]", "0, 0]", "from the top, got (1, 3)"),
    ],
)
def test_environments_that_lack_something_are_refused_by_its_name(before, after, said, tmp_path):
    code = (EXAMPLE / "env.py").read_text()
    assert before in code
    (tmp_path / "env.py").write_text(code.replace(before, after, 1))
    assert said in refused((EXAMPLE / "tune.toml").read_text(), tmp_path)


def test_commands_that_need_a_model_refuse_an_environment(tmp_path):
    out = tmp_path / "out"
    for asked in (
        lambda: train(TrainConfig(task=FILE, out=out)),
        lambda: check(CheckConfig(task=FILE)),
        lambda: record(RecordConfig(task=FILE, out=out)),
    ):
        with pytest.raises(InputError, match="only `simtune tune` takes those"):
            asked()
    with pytest.raises(InputError, match="needs a MuJoCo model"):
        tune(TuneConfig(task=FILE, out=out, search="paper"))
    with pytest.raises(InputError, match="needs a MuJoCo model"):
        tune(TuneConfig(task=FILE, out=out, real_gap=True))
    with pytest.raises(InputError, match=r"steps of 0\.05 s"):
        TASK.simulator(image_size=SIZE, step_s=0.1)
    assert not out.exists()
