"""Films that are mirrored or turned beside readings or actions, of a pusher and of an arm."""

from pathlib import Path

import numpy as np
import pytest

from simtune.budget import Budget
from simtune.cameras.views import View
from simtune.checking import check
from simtune.checking.film.as_read import AsRead
from simtune.checking.film.at_odds import at_odds
from simtune.checking.film.camera_film import CameraFilm
from simtune.checking.film.compare import Comparison
from simtune.checking.film.explanations import AtOdds, Worlds
from simtune.checking.film.features import agreement, moving_roughly
from simtune.checking.film.film_warnings import all_clear, warnings_of_film
from simtune.checking.film.framing import AS_IT_IS, TURNS
from simtune.checking.film.look import look_at
from simtune.checking.film.painted import hidden_background, painted_over
from simtune.checking.film.turned import Turned, turned
from simtune.config import CheckConfig
from simtune.observation import ObservationModel
from simtune.real.observed import observed
from simtune.recordings import write_dataset
from simtune.simulation import Simulator
from simtune.tasks import Task, load_task
from simtune.trajectory import Trajectory

SIZE, STEPS, KEPT, STEP_S = 64, 70, 8, 0.1
SCENE = """
<mujoco>
  <option timestep="0.01" integrator="implicitfast"/>
  <worldbody>
    <camera name="top" pos="0 0 2" fovy="15"/>
    <geom name="table" type="plane" size=".4 .4 .01" rgba=".8 .8 .8 1" contype="0" conaffinity="0"/>
    <body name="pusher" pos="0 0 .011">
      <joint name="x" type="slide" axis="1 0 0"{range}/>
      <joint name="y" type="slide" axis="0 1 0"{range}/>
      <geom name="pusher" type="cylinder" size=".02 .01" mass="1" rgba=".2 .2 .9 1"/>
      <body name="arm">
        <joint name="turn" axis="0 0 1" damping="10"/>
        <geom name="arm" type="box" size=".03 .005 .005" pos=".04 0 .01" mass=".01"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="px" joint="x" kp="100" kv="15"/>
    <position name="py" joint="y" kp="100" kv="15"/>
  </actuator>
</mujoco>
"""
RANGE = ' limited="true" range="-.25 .25"'
TUNE = """
model = "scene.xml"
control_timestep_s = 0.1
camera = "top"

[[sensors]]
name = "pusher"
joints = {joints}
columns = "observation.state"
offset = 0

[[parameters]]
name = "kp"
kind = "gain"
objects = ["px", "py"]
"""
OTHER = '[[sensors]]\nname = "other"\njoints = "y"\n\n'
TABLE = """
[[parameters]]
name = "table"
kind = "colour"
objects = "table"
"""


def write_task(folder: Path, joints: str = '["x", "y"]', more: str = "") -> Task:
    (folder / "scene.xml").write_text(SCENE.format(range=RANGE))
    (folder / "tune.toml").write_text(TUNE.format(joints=joints) + more)
    return load_task(str(folder / "tune.toml"))


class Scene:
    """Episodes in which the pusher goes about, or to and fro along x only."""

    def __init__(
        self, task: Task, *, line: bool = False, travel: float = 0.2, kp: float | None = None
    ):
        self.task = task
        self.seen: ObservationModel = observed(task, None, is_simulated=False)
        self.simulator: Simulator = task.simulator(image_size=SIZE)
        rng, times = np.random.default_rng(0), np.arange(STEPS) * STEP_S
        phases, speeds = rng.uniform(0, 6, (2, 3, 2, 1)) * np.array([[[[1]]], [[[0.3]]]])
        self.actions = travel * np.sin((0.7 + speeds) * times + phases).swapaxes(1, 2)
        self.actions[..., 1] *= not line
        worlds = np.tile(task.parameters.nominal if kp is None else [kp], (3, 1))
        played = self.simulator.roll_out(
            worlds, self.actions, rng, self.seen.observe_beside(), starts=self._starts(worlds, rng)
        )
        self.states, self.parameters = played.states, worlds
        self.readings = self.seen.readings(played.observed, rng)

    def _starts(self, worlds: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        starts, space = self.simulator.begin(worlds, rng).states[:, 0], self.simulator.state_space
        states = np.zeros((3, space.nq + space.nv))
        states[:, :2] = self.actions[:, 0]
        return space.with_positions_and_velocities(starts, states)

    def film(self, late: int = 0) -> np.ndarray:
        """(3, KEPT, SIZE, SIZE, 3) of moments that are `late` steps earlier than readings'."""
        at = np.clip(np.linspace(0, STEPS, KEPT).astype(int) - late, 0, STEPS)
        states = self.states[:, at]
        frames = self.simulator.render(
            states.reshape(3 * KEPT, -1), np.repeat(self.parameters, KEPT, 0)
        )
        noise = np.random.default_rng(1).normal(0, 3, frames.shape)
        noisy = (frames + noise).clip(0, 255).astype(np.uint8)
        return noisy.reshape(3, KEPT, SIZE, SIZE, 3)

    def trajectories(self, frames: np.ndarray | None = None) -> list[Trajectory]:
        frames = np.empty((3, STEPS + 1, 0, 0, 3), np.uint8) if frames is None else frames
        return [
            Trajectory(frames[e], self.actions[e].astype("f"), STEP_S, self._of(e))
            for e in range(3)
        ]

    def _of(self, episode: int) -> dict[str, np.ndarray]:
        return {name: its[episode] for name, its in self.readings.items()}

    def as_read(self) -> AsRead:
        return AsRead(self.simulator, self.seen, self.trajectories())


@pytest.fixture(autouse=True)
def _few_worlds(monkeypatch):
    """Films are beside half as many worlds that play their actions: these take longest."""
    monkeypatch.setattr("simtune.checking.film.played._WORLDS", 4)


@pytest.fixture(scope="module")
def scene(tmp_path_factory) -> Scene:
    return Scene(write_task(tmp_path_factory.mktemp("plane")))


def of(film: np.ndarray, scene: Scene) -> Turned | None:
    return turned({0: np.ascontiguousarray(film)}, scene.as_read()).get(0)


@pytest.mark.parametrize("late", [-1, 0, 2])
def test_a_film_as_readings_have_it_is_not_turned_even_if_it_is_late(scene, late):
    assert of(scene.film(late), scene) is None


@pytest.mark.parametrize(
    ("turn", "says", "joints"),
    [
        (lambda f: f[..., ::-1, :], "mirrored left to right", {"x"}),
        (lambda f: f[:, :, ::-1], "mirrored top to bottom", {"y"}),
        (lambda f: f[:, :, ::-1, ::-1], "upside down", {"x", "y"}),
        (lambda f: np.rot90(f, 1, (2, 3)), "turned by 90° counterclockwise", set()),
        (lambda f: np.rot90(f, -1, (2, 3)), "turned by 90° clockwise", set()),
        (lambda f: f.swapaxes(2, 3), "mirrored, and turned by 90°", set()),
    ],
)
def test_a_turned_film_is_told_by_readings_and_which_signs_would_do_it(scene, turn, says, joints):
    found = of(turn(scene.film(1)), scene)
    assert found is not None
    assert found.says == says
    assert set(found.reversed) == joints
    assert found.elsewhere is None


def test_what_looks_the_same_when_mirrored_is_not_told(tmp_path):
    line = Scene(write_task(tmp_path), line=True)
    assert of(line.film()[:, :, ::-1], line) is None
    found = of(line.film()[..., ::-1, :], line)
    assert found is not None
    assert found.says == "mirrored left to right or upside down"
    assert found.reversed == ["x"]


def test_other_moments_tell_nothing(scene):
    """Frames in another order agree with readings no better in any way."""
    shuffled = scene.film()[:, np.random.default_rng(0).permutation(KEPT)]
    for turn in TURNS:
        assert of(turn.undo(shuffled)[0], scene) is None


@pytest.mark.parametrize(
    ("joints", "moves"), [('"turn"', []), ('["x", "turn"]', []), ('["x", "y"]', ["x", "y"])]
)
def test_nothing_moves_that_something_unmeasured_carries(tmp_path, joints, moves):
    (tmp_path / "scene.xml").write_text(SCENE.format(range=RANGE))
    text = TUNE.format(joints=joints)
    if "x" in joints and "turn" in joints:  # slides and hinges need sensors of their own
        own = OTHER.replace('"y"', '"turn"')
        text = TUNE.format(joints='"x"').replace("[[parameters]]", own + "[[parameters]]")
    (tmp_path / "tune.toml").write_text(text)
    task = load_task(str(tmp_path / "tune.toml"))
    assert [name for name, _ in Scene(task).as_read().joints] == moves


def test_a_hinge_whose_zero_is_elsewhere_turns_no_film_for_sure(tmp_path):
    swing = SCENE.replace('type="slide" axis="1 0 0"{range}', 'axis="0 0 1"').format(range=RANGE)
    swing = swing.replace('<geom name="pusher" type="cylinder"', '<geom name="bob" pos="0 -.15 0"')
    swing = swing.replace('size=".02 .01"', 'size=".02"')
    (tmp_path / "scene.xml").write_text(swing)
    text = TUNE.format(joints='"x"').replace("offset = 0\n", "")
    (tmp_path / "tune.toml").write_text(text.replace("[[parameters]]", OTHER + "[[parameters]]"))
    scene = Scene(load_task(str(tmp_path / "tune.toml")), line=True, travel=0.8)
    film = scene.film()
    assert of(film, scene) is None
    scene.readings["pusher"] = scene.readings["pusher"] + np.pi
    found = of(film, scene)
    assert found is not None
    assert (found.says, found.elsewhere) == ("upside down", "x")


def test_what_is_said_of_a_turned_film():
    film = CameraFilm("top", np.empty((0, 0, 0, 0, 3), np.uint8), View("top"), is_plate=True)
    comparison = Comparison(1, AS_IT_IS, 1, 1, 1, 0.1, 0.1, np.zeros((1, 1), int))
    top, upside_down, on_its_side = TURNS[1], TURNS[2], TURNS[5]
    (said,) = warnings_of_film(film, comparison, turned=Turned([top], ["y"]))
    assert said == (
        "the film is mirrored top to bottom, against what readings say: mirror the film back, or "
        "reverse the sign of y in the sensor (and in [actions], if both agree)"
    )
    (said,) = warnings_of_film(film, comparison, turned=Turned([upside_down], [], "hinge"))
    assert said.endswith("turn the film back, or the camera; or is the zero of hinge elsewhere?")
    (said,) = warnings_of_film(film, comparison, turned=Turned([on_its_side], []))
    assert said.endswith("or are columns of readings exchanged?")
    assert warnings_of_film(film, comparison) == []


@pytest.mark.thorough
@pytest.mark.parametrize("flipped", [pytest.param(False, marks=pytest.mark.slow), True])
def test_the_command_warns_of_a_film_that_is_turned(tmp_path, flipped, small_library):
    task = write_task(tmp_path)
    scene = Scene(task)
    nominal = np.repeat(scene.parameters, STEPS + 1, 0)
    frames = scene.simulator.render(scene.states.reshape(len(nominal), -1), nominal)
    frames = frames.reshape(3, STEPS + 1, SIZE, SIZE, 3)[:, :, :: -1 if flipped else 1]
    write_dataset(
        tmp_path / "film",
        scene.trajectories(np.ascontiguousarray(frames)),
        action_names=["px", "py"],
        robot_type="pusher",
        task="push",
        reading_names={"pusher": ["x", "y"]},
    )
    (tmp_path / "tune.toml").write_text(
        TUNE.format(joints='["x", "y"]').replace('"observation.state"', '["x", "y"]')
    )
    config = CheckConfig(task=str(tmp_path / "tune.toml"), real=str(tmp_path / "film"))
    found = check(config)
    said = "mirrored top to bottom" if flipped else None
    assert found["films"]["top"]["against_readings"] == said
    assert any("against what readings say" in its for its in found["warnings"]) == flipped


# --- beside actions -----------------------------------------------------------------------


def actions_of(scene: Scene) -> dict[str, np.ndarray]:
    return {f"push{e}": actions for e, actions in enumerate(scene.actions)}


def beside_actions(film: np.ndarray, scene: Scene, actions: dict[str, np.ndarray], seed: int = 0):
    films = {0: np.ascontiguousarray(film)}
    return at_odds(films, scene.simulator, actions, seed).get(0)


@pytest.mark.thorough
@pytest.mark.parametrize("late", [0, 2])
def test_a_film_that_follows_its_actions_needs_no_explanation(scene, late):
    assert beside_actions(scene.film(late), scene, actions_of(scene)) is None


@pytest.mark.thorough
@pytest.mark.parametrize("factor", [0.25, 4])
def test_a_film_of_softer_or_stiffer_servos_needs_no_explanation(tmp_path, factor):
    scene = Scene(write_task(tmp_path), kp=factor * 100)
    assert beside_actions(scene.film(), scene, actions_of(scene)) is None


@pytest.mark.thorough
def test_a_mirrored_film_is_told_by_actions_and_so_is_the_sign_that_would_do(scene):
    found = beside_actions(scene.film()[..., ::-1, :], scene, actions_of(scene))
    assert [framing.says for framing in found.framings] == ["mirrored left to right"]
    assert found.reversed == ["the action px"]


@pytest.mark.thorough
def test_what_there_is_no_time_to_explain_is_said(scene, small_library):
    frames = np.ascontiguousarray(scene.film()[..., ::-1, :])
    film = CameraFilm("top", frames, scene.simulator.views[0], True)
    given = [film], scene.simulator, scene.actions, 0, None, actions_of(scene)
    (look,) = look_at(*given, Budget(1e-3))
    assert look.why.odd is None
    assert any("was not looked for, which would take about" in said for said in look.warnings)


@pytest.mark.thorough
def test_all_reversed_signs_look_as_if_the_film_were_upside_down(scene):
    negated = {name: -actions for name, actions in actions_of(scene).items()}
    found = beside_actions(scene.film(), scene, negated)
    assert [framing.says for framing in found.framings] == ["upside down"]
    assert found.reversed == ["all actions"]


@pytest.mark.thorough
def test_exchanged_actions_are_told_by_their_episodes_names(scene):
    first, second, third = actions_of(scene).items()
    names, actions = zip(first, second, third, strict=True)
    exchanged = dict(zip(names, [actions[1], actions[0], actions[2]], strict=True))
    found = beside_actions(scene.film(), scene, exchanged)
    assert found == AtOdds(actions_of={"push0": "push1", "push1": "push0"})


@pytest.mark.thorough
def test_equal_actions_or_a_single_episode_tell_nothing(scene):
    one = {"push0": scene.actions[0]}
    mirrored = scene.film()[:1, ..., ::-1, :]
    assert beside_actions(mirrored, scene, one) is None
    same = dict.fromkeys(("push0", "push1"), scene.actions[0])
    assert beside_actions(scene.film()[[0, 0]], scene, same) is None


def test_motors_are_not_told_of(scene, monkeypatch):
    not_servos = scene.simulator.model.nu * [False]
    monkeypatch.setattr(
        "simtune.checking.film.at_odds.position_servos", lambda model: np.array(not_servos)
    )
    assert beside_actions(scene.film()[..., ::-1, :], scene, actions_of(scene)) is None


def drawn_bars(at: np.ndarray) -> np.ndarray:
    """(E, K, SIZE, SIZE, 3) pictures of a bar that is `at` (E, K) columns."""
    frames = np.full((*at.shape, SIZE, SIZE, 3), 90, np.uint8)
    for frame, column in zip(frames.reshape(-1, SIZE, SIZE, 3), at.ravel(), strict=True):
        frame[6:26, column : column + 6] = 220
    return frames


def test_bars_beside_worlds_are_explained_only_if_they_move_otherwise():
    at = np.random.default_rng(0).integers(4, 50, (3, KEPT))
    worlds = Worlds(np.stack([drawn_bars(at + shift) for shift in (-2, 0, 1, 2)]))
    right, wrong = drawn_bars(at - 1), drawn_bars(at - 1)[..., ::-1, :]
    assert not worlds.is_poor(right)
    assert worlds.is_poor(wrong)
    found = worlds.explain(wrong, [], {}, ["a", "b", "c"])
    assert found is not None
    assert [framing.says for framing in found.framings] == ["mirrored left to right"]
    assert worlds.explain(drawn_bars(at[[1, 0, 2]]), [], {}, ["a", "b", "c"]) == AtOdds(
        actions_of={"a": "b", "b": "a"}
    )


def test_what_explains_a_film_nearly_as_well_is_said_though_it_is_just_below_what_is_clear(
    monkeypatch,
):
    at = np.random.default_rng(0).integers(4, 50, (3, KEPT))
    worlds = Worlds(np.stack([drawn_bars(at + shift) for shift in (-2, 0, 1, 2)]))
    film = drawn_bars(at - 1)[..., ::-1, :]
    signs = {"the action px": np.stack([moving_roughly(film)] * 4)}
    mirrored = np.mean([agreement(moving_roughly(film[..., ::-1, :]), w) for w in worlds.moving])
    reversed_sign = agreement(signs["the action px"][0], signs["the action px"][0]).mean()
    assert mirrored < reversed_sign
    between = (mirrored + reversed_sign) / 2
    monkeypatch.setattr("simtune.checking.film.explanations._MIN_COSINE_GAIN", between)
    found = worlds.explain(film, [], signs, ["a", "b", "c"])
    assert found is not None
    assert [framing.says for framing in found.framings] == ["mirrored left to right"]
    assert found.reversed == ["the action px"]
    monkeypatch.setattr("simtune.checking.film.explanations._MIN_COSINE_GAIN", 1.0)
    assert worlds.explain(film, [], signs, ["a", "b", "c"]) is None


def test_nothing_is_explained_if_worlds_say_the_same_of_each_other():
    at = np.random.default_rng(0).integers(4, 50, (3, KEPT))
    sides = [drawn_bars(at + shift) for shift in (0, 1, 2, 3, 4)]
    worlds = Worlds(np.stack([*sides, sides[0][..., ::-1, :]]))  # one swings to the other side
    assert worlds.is_poor(film := sides[1][..., ::-1, :])
    assert worlds.explain(film, [], {}, ["a", "b", "c"]) is None


def test_what_is_said_of_a_film_at_odds_with_its_actions():
    frames = np.zeros((1, 1, 8, 8, 3), np.uint8)
    film = CameraFilm("top", frames, View("top"), is_plate=True)
    comparison = Comparison(1.0, AS_IT_IS, 1.0, 1.03, 1.0, 0.1, 0.1, np.zeros((1, 1), int))
    says = [
        warnings_of_film(film, comparison, at_odds=odds)[0]
        for odds in (
            AtOdds([TURNS[0]], ["the action px"]),
            AtOdds([], ["the action px"]),
            AtOdds(actions_of={"a": "b", "b": "a"}),
        )
    ]
    assert says[0].startswith("the film looks mirrored left to right beside simulated worlds")
    assert "or the sign of the action px is reversed" in says[0]
    assert "as if the sign of the action px were reversed" in says[1]
    assert "in a it follows b's, in b it follows a's; are files" in says[2]


@pytest.mark.thorough
@pytest.mark.parametrize("flipped", [False, True])
def test_looking_at_a_film_says_what_explains_it_beside_actions(scene, flipped, small_library):
    frames = scene.film()[..., :: -1 if flipped else 1, :]
    film = CameraFilm("top", np.ascontiguousarray(frames), scene.simulator.views[0], True)
    (look,) = look_at([film], scene.simulator, scene.actions, 0, None, actions_of(scene))
    odds = {"framings": ["mirrored left to right"], "reversed": ["the action px"], "actions_of": {}}
    assert look.facts()["against_actions"] == (odds if flipped else None)
    assert any("that play its actions" in said for said in look.warnings) == flipped


# --- a colour over a recorded background --------------------------------------------------


@pytest.mark.parametrize("more", ["", TABLE])
def test_a_colour_that_hides_the_recorded_background(tmp_path, more):
    task = write_task(tmp_path, more=more)
    plate = np.full((SIZE, SIZE, 3), 60, np.uint8)
    simulator = task.simulator(image_size=SIZE, views=[View("top", plate=plate)])
    states = Scene(task).states.reshape(3 * (STEPS + 1), -1)
    painted = painted_over(simulator, states, 0)
    assert list(painted) == ["table"] * bool(more)
    said = hidden_background(painted)
    film = CameraFilm("top", np.empty((0, 0, 0, 0, 3), np.uint8), View("top"), True, painted)
    comparison = Comparison(1, AS_IT_IS, 1, 1, 1, 0.1, 0.1, np.zeros((1, 1), int))
    if more:
        assert painted["table"] == pytest.approx(0.97, abs=0.03)
        assert said[0].startswith(f"colour 'table' paints {painted['table']:.0%} of the picture")
        assert "film's own but for what table paints" in all_clear(film, comparison)
        assert painted_over(task.simulator(image_size=SIZE), states, 0) == {}
    else:
        assert said == []
        assert "the background is the film's own, so" in all_clear(film, comparison)
