"""Films of a camera that sways: drawn ones, whose sway is known, beside still ones."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, shift
from test_check_film import library_of

from simtune.cameras.views import View
from simtune.checking.film import look
from simtune.checking.film.camera_film import CameraFilm
from simtune.checking.film.compare import Comparison
from simtune.checking.film.framing import AS_IT_IS
from simtune.checking.film.sway import sway_px, sways, sways_in_words

HEIGHT, WIDTH, KEPT = 96, 128, 8  # of drawn frames, and how many


def room(rng: np.random.Generator, *, is_plain: bool = False) -> np.ndarray:
    """(HEIGHT, WIDTH, 3): a wall with things in front, or without any."""
    picture = np.full((HEIGHT, WIDTH, 3), 150.0)
    for _ in range(0 if is_plain else 14):
        top, left = rng.integers(0, [HEIGHT - 12, WIDTH - 12])
        high, wide = rng.integers(8, 28, 2)
        picture[top : top + high, left : left + wide] = rng.uniform(30, 220, 3)
    return gaussian_filter(picture, (0.7, 0.7, 0))


def filmed(
    still: np.ndarray,
    rng: np.random.Generator,
    away_px: np.ndarray | None = None,
    *,
    mover: np.ndarray | None = None,
    drift: float = 0.0,
    shadow: bool = False,
) -> np.ndarray:
    """(KEPT, HEIGHT, WIDTH, 3) uint8 with camera noise.

    `away_px`: (KEPT, 2) by which the camera's picture is shifted, down and right. `mover`: a
    picture that goes from side to side in front. `drift`: the share by which the exposure changes.
    """
    frames = []
    for k in range(KEPT):
        picture = still.copy()
        if shadow:
            picture[40:70, 5 + 9 * k : 45 + 9 * k] *= 0.6
        if mover is not None:
            high, wide = mover.shape[:2]
            left = round((WIDTH - wide) * (0.5 + 0.5 * np.sin(1.7 * k)))
            picture[-high:, left : left + wide] = mover
        if away_px is not None:
            picture = shift(picture, (*away_px[k], 0), order=1, mode="nearest")
        light = 1 + drift * (k / (KEPT - 1) - 0.5)
        frames.append(picture * light + rng.normal(0, 4, picture.shape))
    return np.clip(frames, 0, 255).astype(np.uint8)


def swayed(rng: np.random.Generator, rms_px: float) -> np.ndarray:
    """(KEPT, 2) of this root mean square, in pixels of 64, around no median."""
    away = rng.normal(0, 1, (KEPT, 2))
    away -= np.median(away, 0)
    return away * rms_px / np.sqrt((away**2).sum(1).mean()) * HEIGHT / 64


@pytest.mark.parametrize("rms_px", [0.25, 0.6, 1.5])
@pytest.mark.parametrize("seed", range(3))
def test_a_sway_is_measured_beside_what_moves_by_itself(rms_px, seed):
    rng = np.random.default_rng(seed)
    mover = room(rng)[:60, :40]  # a fifth of the picture, which moves over most of its lower part
    frames = filmed(room(rng), rng, swayed(rng, rms_px), mover=mover, drift=0.2)
    assert sway_px(frames) == pytest.approx(rms_px, rel=0.25)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("is_plain", [False, True])
@pytest.mark.parametrize("size", [(0, 0), (30, 40), (80, 56)])  # up to a third of the picture
def test_a_still_camera_does_not_sway_whatever_moves(size, is_plain, seed):
    rng = np.random.default_rng(seed)
    mover = room(rng)[: size[0], : size[1]] if size[0] else None
    still = room(rng, is_plain=is_plain)
    assert sway_px(filmed(still, rng, mover=mover)) == 0
    assert sway_px(filmed(still, rng, mover=mover, drift=0.2, shadow=True)) == 0


def test_a_sway_of_a_plain_room_is_not_told():
    rng = np.random.default_rng(0)
    assert sway_px(filmed(room(rng, is_plain=True), rng, swayed(rng, 0.6))) == 0


def test_the_warning_says_how_much_where_and_what_to_do():
    rng = np.random.default_rng(1)
    still = room(rng)
    frames = np.stack([filmed(still, rng, swayed(rng, px)) for px in (0.4, 0.0, 0.8)])
    film = CameraFilm("front", frames, View("front"), False, episodes=("a", "b", "c"), own_px=480)
    found = sways(film)
    assert list(found) == ["a", "c"]
    said = sways_in_words(found, film)
    assert said.startswith(
        f"the camera sways: in c, what stands still moves by {found['c'] * 7.5:.2g} of the film's "
        "480 pixels in height (root mean square), and less in a (of 3 looked at)"
    )
    assert "--leave-out" in said


def test_only_a_camera_that_stands_still_in_the_model_is_said_to_sway(monkeypatch):
    rng = np.random.default_rng(1)
    frames = filmed(room(rng), rng, swayed(rng, 0.8))[None]
    film = CameraFilm("front", frames, View("front"), False, episodes=("a",))
    same = Comparison(1, AS_IT_IS, 1, 1, 1, 0.1, 0.1, np.zeros((1, KEPT), int))
    for name, its in (
        ("make_libraries", [library_of(film.squares)]),
        ("compare", same),
        ("resting_parts", []),
        ("painted_over", {}),
    ):
        monkeypatch.setattr(look, name, lambda *_, its=its: its)

    def said_of(film: CameraFilm, *, moves: bool = False) -> tuple[list[str], dict[str, float]]:
        monkeypatch.setattr(look, "camera_moves", lambda *_: moves)
        (its,) = look.look_at([film], SimpleNamespace(model=None), np.zeros((1, 8, 2)), 0)
        return [said for said in its.warnings if "sways" in said], its.facts()["sway_px"]

    (said,), px = said_of(film)
    assert "in a, what stands still moves by 0.7" in said
    assert "pixels of 64" in said
    assert px == pytest.approx({"a": 0.8}, rel=0.1)
    unknown = replace(film, view=View("front", background_is_unknown=True))
    assert said_of(unknown) == ([], {})
    assert said_of(film, moves=True) == ([], {})
