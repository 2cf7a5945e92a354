"""`simtune check` looks at the film: drawn scenes whose framing is known, and a simulated one."""

from dataclasses import replace
from pathlib import Path

import av
import numpy as np
import pytest
from test_check import PENDULUM, make_task, pendulum

from simtune.cameras.views import View
from simtune.checking import check
from simtune.checking.film import compare as film
from simtune.checking.film import look
from simtune.checking.film.camera_film import CameraFilm
from simtune.checking.film.compare import compare
from simtune.checking.film.exchanged import exchanged
from simtune.checking.film.features import SIZE, describe, likeness, moving_share, squeezed
from simtune.checking.film.film_warnings import all_clear, warnings_of_film
from simtune.checking.film.framing import AS_IT_IS, FRAMINGS, MIRRORED
from simtune.checking.film.library import Library, make_libraries
from simtune.checking.film.resting import in_words, resting_parts
from simtune.checking.picture_files import picture_file
from simtune.config import CheckConfig, TuneConfig
from simtune.errors import InputError
from simtune.experiment.experiment import build_experiment
from simtune.recordings import write_dataset
from simtune.simulation import random_actions
from simtune.tasks import TASKS, Task
from simtune.trajectory import Trajectory

HALF = SIZE // 2


def drawn(num_worlds: int, num_pictures: int, seed: int) -> np.ndarray:
    """(W, K, SIZE, SIZE, 3) worlds of colours of their own: a still L, a floor, a moving bar."""
    rng = np.random.default_rng(seed)
    frames = np.empty((num_worlds, num_pictures, SIZE, SIZE, 3), np.uint8)
    for world in frames:
        back, floor, still, bar = rng.permutation([30, 90, 150, 230])[:, None] + rng.integers(
            0, 25, (4, 3)
        )
        for picture in world:
            picture[:44], picture[44:] = back, floor
            picture[8:36, 10:14] = picture[32:36, 10:24] = still
            at = rng.integers(26, 50)
            picture[30:48, at : at + 6] = bar
    return frames


def library_of(frames: np.ndarray) -> Library:
    states = np.zeros((*frames.shape[:2], 1))
    return Library(states, frames, describe(frames))


def filmed(frames: np.ndarray, *, is_plate: bool = False) -> CameraFilm:
    return CameraFilm("front", frames, View("front"), is_plate)


def said_of(frames: np.ndarray, library: Library) -> list[str]:
    return warnings_of_film(filmed(frames), compare(squeezed(frames), library))


@pytest.fixture(scope="module")
def library() -> Library:
    return library_of(drawn(12, 12, 0))


@pytest.fixture(autouse=True, scope="module")
def _own_worlds_compared_once():
    """What a library's own worlds tell is the same beside each film, and takes longest.

    A third of their pictures is enough here.
    """
    found: dict[int, tuple[Library, float]] = {}

    def own_gain_once(library: Library) -> float:
        if id(library) not in found:
            found[id(library)] = library, own_gain(library)
        return found[id(library)][1]

    own_gain = film._own_gain
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(film, "_own_gain", own_gain_once)
        patch.setattr(film, "_JUDGED_SIZES", (5, 4))
        yield


# --- features -----------------------------------------------------------------------------


def test_edges_are_twice_their_angle_whatever_the_colours():
    upright, lying = np.zeros((2, 1, 1, SIZE, SIZE, 3), np.uint8)
    upright[..., :HALF, :] = 200
    lying[..., :HALF, :, :] = 200
    fields = [describe(p).edges.reshape(HALF, HALF, 2) for p in (upright, 255 - upright, lying)]
    middle = HALF // 2
    np.testing.assert_array_equal(fields[0], fields[1])  # dark to bright as bright to dark
    assert fields[0][middle, middle, 0] > 0.5  # cos 0°
    assert fields[2][middle, middle, 0] < -0.5  # cos 180°
    assert np.abs(fields[0][..., 1]).max() == 0
    assert np.abs(fields[0][:, 4]).max() == 0  # nothing there


def test_moving_is_what_differs_from_the_median():
    frames = np.full((1, 5, SIZE, SIZE, 3), 50, np.uint8)
    for k in range(5):
        frames[0, k, 20:28, 10 * k : 10 * k + 8] = 220
    field = describe(frames).moving.reshape(5, HALF, HALF)
    assert field[2, 11:13, 11:13].min() > 0.9
    assert field[2, :, 18:].max() == 0
    # 8 × 8 of 64 × 64 pixels, with a rim that is smoothed
    assert moving_share(frames)[0] == pytest.approx(8 * 8 / SIZE**2, rel=0.7)


def test_likeness_of_a_picture_to_itself_is_one_and_of_nothing_none():
    features = describe(drawn(1, 8, 0))
    np.testing.assert_allclose(likeness(features, features)[:, [0, 1], [0, 1]], 1, rtol=1e-5)
    black = describe(np.zeros((1, 8, SIZE, SIZE, 3), np.uint8))
    assert np.abs(likeness(black, features)).max() == 0


# --- framings -----------------------------------------------------------------------------


def test_undoing_moves_pixels_back_and_says_which_were_seen():
    rng = np.random.default_rng(0)
    picture = rng.integers(0, 256, (1, 1, 40, 40, 3), np.uint8)
    by_name = {framing.says: framing for framing in FRAMINGS}
    same, seen = AS_IT_IS.undo(picture)
    np.testing.assert_array_equal(same, picture)
    assert seen.all()
    mirrored, _ = MIRRORED.undo(picture)
    np.testing.assert_array_equal(mirrored, picture[..., ::-1, :])
    turned, _ = by_name["turned by 90° counterclockwise"].undo(np.rot90(picture, 1, (2, 3)))
    np.testing.assert_array_equal(turned, picture)
    moved = np.roll(picture, 8, 3)  # a fifth of the width
    back, seen = by_name["shifted to the right by 0.2 of its width"].undo(moved)
    np.testing.assert_array_equal(back[..., :32, :], picture[..., :32, :])
    np.testing.assert_array_equal(seen, np.arange(40)[None] < 32 + 0 * np.arange(40)[:, None])


def test_undoing_a_stretch_halves_slopes():
    ramp = np.broadcast_to(np.arange(60, dtype=np.uint8)[:, None], (1, 1, 60, 60, 3)).copy()
    stretch = next(f for f in FRAMINGS if f.says == "stretched horizontally by 1.33")
    undone, seen = stretch.undo(ramp)
    slopes = np.diff(undone[0, 0, 30, 10:50, 0].astype(float))
    assert slopes.mean() == pytest.approx(4 / 3, rel=0.03)
    assert seen.all(0).sum() == pytest.approx(45, abs=1)


# --- comparisons --------------------------------------------------------------------------


@pytest.mark.thorough
def test_another_world_of_the_scene_is_no_other_scene(library):
    comparison = compare(drawn(3, 8, 1), library)
    assert warnings_of_film(filmed(drawn(3, 8, 1)), comparison) == []
    assert comparison.alike > 0.9
    assert comparison.moving_share == pytest.approx(comparison.simulated_moving_share, rel=0.3)
    # The bar of the nearest picture is where the film's is.
    film = drawn(1, 8, 2)
    nearest = compare(film, library).nearest[0]
    pictures = library.frames.reshape(-1, SIZE, SIZE, 3)[nearest].astype(int)
    for picture, own in zip(pictures, film[0].astype(int), strict=True):
        ends = [np.abs(np.diff(p[38, 25:], axis=0)).sum(-1).argmax() for p in (picture, own)]
        assert min(abs(ends[0] - ends[1]), abs(abs(ends[0] - ends[1]) - 6)) <= 1


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("frame", "says"),
    [
        (lambda f: f[..., ::-1, :], "mirrored left to right"),
        (lambda f: f[:, :, ::-1, ::-1], "upside down"),
        (lambda f: np.rot90(f, 1, (2, 3)), "turned by 90° counterclockwise"),
        (lambda f: f[:, :, :, 8:56], "stretched horizontally by 1.33"),
        (lambda f: f[:, :, 8:56], "stretched vertically by 1.33"),
        (lambda f: f[:, :, 7:57, 7:57], "enlarged 1.3 times: its field of view is narrower"),
        (lambda f: np.roll(f, 13, 3), "shifted to the right by 0.2 of its width"),
    ],
)
def test_a_framing_is_recognised(library, frame, says):
    said = said_of(frame(drawn(3, 8, 1)), library)
    assert said == [f"beside the simulator's pictures the film looks {says}"]


@pytest.mark.thorough
@pytest.mark.parametrize(("framed", "is_told"), [((0.862, 0.721), False), ((0.93, 0.82), True)])
def test_a_framing_must_make_up_for_what_is_unlike(library, monkeypatch, framed, is_told):
    """Similarities of an arm with a shadow, which hangs elsewhere in the untuned simulator."""

    def best(pictures, framing, *_):
        alike = (0.834, 0.69) if framing is AS_IT_IS else framed
        return np.broadcast_to(np.array(alike)[:, None, None], (2, *pictures.shape[:2]))

    monkeypatch.setattr(film, "_best", best)
    monkeypatch.setattr(film, "_own_likeness", lambda _: np.array([0.969, 0.876]))
    assert compare(drawn(3, 8, 1), library).is_reframed == is_told


@pytest.mark.thorough
def test_another_scene_and_a_still_film_are_warned_of(library):
    film = drawn(3, 8, 1)
    rng = np.random.default_rng(0)
    other = np.empty_like(film)
    for episode in other:
        for picture in episode:
            picture[...] = 60
            picture[10:20] = 200
            at = rng.integers(5, 40)
            picture[at : at + 16, 30:50] = 140
    (said,) = said_of(other, library)
    assert "another scene" in said
    room = 'where the room around, or a shadow, is not in the model, say background = "{}"'
    assert said.endswith(f"to each other; {room.format('recording')}")
    comparison = compare(other, library)
    (said,) = warnings_of_film(filmed(other), comparison, camera_moves=True)  # such as a wrist's
    assert said.endswith(f"to each other; {room.format('unknown')}")
    unknown = replace(filmed(other), view=View("front", background_is_unknown=True))
    assert warnings_of_film(unknown, comparison) == []
    (said,) = warnings_of_film(filmed(other, is_plate=True), compare(other, library))
    assert said.endswith("to each other; or something else moves, such as a shadow")
    (said,) = said_of(film[:, :1].repeat(8, 1), library)
    assert said.startswith("nothing moves in the film")


@pytest.mark.thorough
def test_a_simulator_in_which_nothing_moves_is_no_other_scene_but_stuck(library):
    stuck = library_of(library.frames[:, :1].repeat(12, 1))
    film = drawn(3, 8, 1)
    (said,) = said_of(film, stuck)
    assert said.startswith("things move in the film, and nothing moves in the simulator")
    # A camera's noise, where nothing moves in the film either, is no motion.
    still = film[:, :1].repeat(8, 1).astype(int)
    noise = np.random.default_rng(0).normal(0, 2, still.shape)
    still = (still + noise).clip(0, 255).astype(np.uint8)
    assert not any("stuck" in said for said in said_of(still, stuck))


@pytest.mark.thorough
def test_a_library_is_of_worlds_that_play_the_actions(monkeypatch):
    task = pendulum()
    simulator = task.simulator(image_size=SIZE)
    actions = random_actions(2, 30, simulator.action_mapping, np.random.default_rng(0))
    (library,) = make_libraries(simulator, actions, seed=0)
    assert library.frames.shape == (32, 24, SIZE, SIZE, 3)
    assert len(np.unique(library.worlds)) == 32
    worlds = np.arange(0, 32, 5)
    film = library.frames[worlds, ::3]
    comparison = compare(film, library)
    assert warnings_of_film(filmed(film), comparison) == []
    found = comparison.nearest == 24 * worlds[:, None] + np.arange(0, 24, 3)
    # .48 to .64 by seeds 0 to 3: others look the same, or nearly so, as colours do not count
    assert found.mean() > 0.4
    other = make_task("other", PENDULUM.replace("0 -6.0 0", "0 -4 0"), list(task.parameters))
    monkeypatch.setattr("simtune.checking.film.library._WORLDS", 8)
    (near,) = make_libraries(other.simulator(image_size=SIZE), actions, seed=1)
    (said,) = said_of(near.frames[:2, ::3], library)
    assert "enlarged 1.5 times" in said


def test_exchanged_films_are_told_by_what_moves_alone(library):
    # All stand before their own backgrounds: nothing but the bar tells the cameras apart.
    film, plain = drawn(2, 8, 1), library.frames
    upright = [film, np.rot90(film, 1, (2, 3))]
    libraries = [library, library_of(np.rot90(plain, 1, (2, 3)))]
    assert exchanged([filmed(one) for one in upright], libraries) == {}
    assert exchanged([filmed(one) for one in upright[::-1]], libraries) == {0: 1, 1: 0}
    # A lens makes 4:3 a little wider; an upright film is no wide camera's
    wider, taller = (upright[0].repeat(n, axis) for n, axis in ((17, 3), (2, 2)))
    assert exchanged([filmed(upright[1]), filmed(wider[..., ::16, :])], libraries) == {0: 1, 1: 0}
    assert exchanged([filmed(upright[1]), filmed(taller)], libraries) == {}
    before_its_own = filmed(upright[1], is_plate=True)
    (said,) = warnings_of_film(before_its_own, compare(upright[1], library), exchanged_with="side")
    assert said.endswith("are their keys exchanged?")


def test_before_the_films_own_background_no_other_scene_is_ruled_out(library):
    film = drawn(2, 8, 1)
    comparison, said = compare(film, library), "nothing says that this is another scene"
    assert all_clear(filmed(film), comparison).startswith(said)
    assert "only what moves was compared" in all_clear(filmed(film, is_plate=True), comparison)


def test_a_camera_that_moves_may_have_another_one_s_film(library, monkeypatch):
    """Such as a wrist's, of which only what moves is compared, too."""
    simulator = pendulum().simulator(image_size=SIZE)
    film, turned = drawn(2, 8, 1), library_of(np.rot90(library.frames, 1, (2, 3)))
    films = [filmed(np.rot90(film, 1, (2, 3))), replace(filmed(film), name="wrist")]
    for name, its in (
        ("make_libraries", [library, turned]),
        ("resting_parts", []),
        ("painted_over", {}),
        ("camera_moves", True),
    ):
        monkeypatch.setattr(look, name, lambda *_, its=its: its)
    said = look.named_warnings(look.look_at(films, simulator, np.zeros((2, 8, 2)), seed=0))
    assert [told.partition(":")[0] for told in said] == ["camera front", "camera wrist"]
    assert all(told.endswith("are their keys exchanged?") for told in said)


def test_what_rests_in_a_background_is_told_in_its_number():
    assert in_words(["flap"]) == (
        "the background shows what moves: flap, which rests in most frames; when it moves, the "
        "simulator shows it twice: give a picture of the scene without it as background, or record "
        "episodes in which it rests less"
    )
    several = in_words(["shoulder", "upper"])
    assert "shoulder, upper, which rest in most frames; when they move, the simulator" in several
    assert several.endswith(
        "shows them twice: give a picture of the scene without them as "
        "background, or record episodes in which they rest less"
    )


@pytest.mark.parametrize("shown", [True, False])
def test_a_part_that_rests_is_said_to_be_in_the_background_if_that_shows_it(shown):
    task = pendulum()
    before = task.simulator(image_size=SIZE)
    nominal = np.tile(task.parameters.nominal, (2, 1))
    played = before.roll_out(
        nominal, np.zeros((2, 4, before.num_actions)), np.random.default_rng(0)
    )
    states = played.states[:, :1].repeat(6, 1)
    (first,) = before.render(states[:1, 0], nominal[:1])
    plate = first if shown else np.full_like(first, 128)
    view = replace(before.views[0], plate=plate)
    simulator = task.simulator(image_size=SIZE, views=[view])
    frames = simulator.render(states.reshape(12, -1), nominal.repeat(6, 0))
    frames = frames.reshape(2, 6, *frames.shape[1:])
    library = Library(states, frames, describe(frames))
    assert bool(resting_parts(simulator, library, 0)) == shown


# --- the command --------------------------------------------------------------------------


def record(task: Task, folder: Path, *, mirrored: bool) -> None:
    """Two episodes of the task's nominal world."""
    simulator = task.simulator(image_size=SIZE)
    rng = np.random.default_rng(0)
    actions = random_actions(2, 30, simulator.action_mapping, rng)
    played = simulator.roll_out(np.tile(task.parameters.nominal, (2, 1)), actions, rng)
    episodes = [
        Trajectory(frames[:, :, :: -1 if mirrored else 1], taken.astype("f"), simulator.step_s)
        for frames, taken in zip(simulator.film(played), actions, strict=True)
    ]
    write_dataset(folder, episodes, action_names=["turn", "idle"], robot_type="arm", task="swing")


@pytest.mark.thorough
@pytest.mark.parametrize("mirrored", [True, False])
def test_tune_tells_a_mirrored_film_before_it_tunes(mirrored, tmp_path, small_library):
    task = pendulum()
    record(task, tmp_path / "film", mirrored=mirrored)
    config = TuneConfig(task="pendulum", real=str(tmp_path / "film"), out=tmp_path / "run")
    told = build_experiment(config, task=task).film_warnings()
    says = "beside the simulator's pictures the film looks mirrored left to right"
    assert told == [says] * mirrored


@pytest.mark.thorough
def test_tune_and_check_name_the_episode_in_which_a_camera_sways(
    tmp_path, monkeypatch, small_library
):
    """How much is seen in tests/checking/test_sway.py."""
    task, folder = pendulum(), tmp_path / "film"
    record(task, folder, mirrored=False)
    monkeypatch.setattr(look, "sways", lambda film: {film.episodes[-1]: 0.5})
    config = TuneConfig(task="pendulum", real=str(folder), out=tmp_path / "run")
    (said,) = build_experiment(config, task=task).film_warnings()
    assert "in episode 1, what stands still moves by 0.5 pixels of 64 (root" in said
    monkeypatch.setitem(TASKS, "pendulum", lambda: task)
    facts = check(CheckConfig(task="pendulum", real=folder))
    says = "in episode 1, what stands still moves by 0.5 of the film's 64 pixels in height"
    assert any(says in said for said in facts["warnings"])
    assert facts["films"][""]["sway_px"] == {"episode 1": 0.5}


@pytest.mark.thorough
def test_films_of_a_simulated_world_are_not_compared(tmp_path):
    config = TuneConfig(task="pendulum", out=tmp_path / "run", real_episodes=2)
    assert build_experiment(config, task=pendulum()).film_warnings() == []


@pytest.mark.thorough
def test_check_saves_a_picture_and_says_where(tmp_path, monkeypatch, capsys, small_library):
    from simtune import cli

    task, folder, path = pendulum(), tmp_path / "mirrored", tmp_path / "seen.png"
    monkeypatch.setitem(TASKS, "pendulum", lambda: task)
    record(task, folder, mirrored=True)
    arguments = ["simtune", "check", "pendulum", "--real", str(folder), "--pictures", str(path)]
    path.write_bytes(b"\x89PNG\r\n\x1a\nof the last check")  # which is replaced
    monkeypatch.setattr("sys.argv", arguments)
    cli.main()
    lines = capsys.readouterr().out.splitlines()
    assert f"pictures of the recordings beside the simulator's: {path}" in lines
    assert any("the film looks mirrored left to right" in line for line in lines)
    with av.open(path) as container:
        (picture,) = container.decode(video=0)
    assert picture.height > picture.width > 600


def test_where_pictures_cannot_go(tmp_path):
    recorded = tmp_path
    for name in ("there.png", "both-servos.png", "several-wrist.png"):
        (tmp_path / name).write_text("notes")
    for options, message in (
        ({"pictures": tmp_path / "a.png"}, "goes with recordings only"),
        ({"real": recorded, "pictures": tmp_path / "a.jpg"}, "ends in .png"),
        ({"real": recorded, "pictures": tmp_path / "b" / "a.png"}, "there is no folder"),
        (
            {"real": recorded, "camera_pose": tmp_path / "c.toml", "pictures": tmp_path / "a.png"},
            "goes with a check without --camera-pose",
        ),
        (
            {"real": recorded, "pictures": tmp_path / "there.png"},
            r"/there.png exists and is no PNG, so it is not replaced; name another file",
        ),
        (
            {"real": recorded, "pictures": tmp_path / "both.png"},
            r"both.png: \S+/both-servos.png exists and is no PNG",
        ),
    ):
        with pytest.raises(InputError, match=message):
            CheckConfig(task="pendulum", **options).check()
    several = tmp_path / "several.png"
    CheckConfig(task="pendulum", real=recorded, pictures=several).check()
    assert picture_file(several, "-front") == tmp_path / "several-front.png"
    with pytest.raises(InputError, match=r"several-wrist.png exists and is no PNG"):  # of a camera
        picture_file(several, "-wrist")
    assert (tmp_path / "several-wrist.png").read_text() == "notes"


def test_a_picture_is_replaced_by_the_next_check_s(tmp_path):
    for name in ("seen.png", "seen-servos.png", "seen-front.png"):
        (tmp_path / name).write_bytes(b"\x89PNG\r\n\x1a\nof the last check")
    (tmp_path / "seen-wrist.png").touch()
    path = tmp_path / "seen.png"
    CheckConfig(task="pendulum", real=tmp_path, pictures=path).check()
    for which in ("", "-servos", "-front", "-wrist"):
        assert picture_file(path, which) == tmp_path / f"seen{which}.png"
