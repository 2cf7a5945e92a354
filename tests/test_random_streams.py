"""A seed's random numbers are independent for each purpose."""

import re
from pathlib import Path

import numpy as np
import torch

from simtune.networks.layers import seeded
from simtune.random_streams import Purpose, stream

SOURCES = Path(__file__).parents[1] / "src" / "simtune"


def test_purposes_and_their_parts_have_streams_of_their_own():
    """numpy takes a 0 at the end of a seed for nothing."""
    drawn = {purpose.name: stream(7, purpose).random() for purpose in Purpose}
    drawn |= {f"{p.name} {n}": stream(7, p, n).random() for p in Purpose for n in range(3)}
    drawn["the plain seed"] = np.random.default_rng(7).random()
    assert len(set(drawn.values())) == len(drawn) == 4 * len(Purpose) + 1


def test_the_same_seed_purpose_and_part_draw_the_same():
    for purpose in Purpose:
        assert stream(3, purpose, 2).random() == stream(3, purpose, 2).random()
    assert stream(3, Purpose.SCORE).random() != stream(4, Purpose.SCORE).random()


def test_no_other_place_makes_a_generator_from_a_seed():
    """But for fixed numbers, and where a number is no user's seed."""
    found = [
        f"{path.relative_to(SOURCES)}: {argument}"
        for path in sorted(SOURCES.rglob("*.py"))
        for argument in re.findall(r"default_rng\(([^0-9][^)]*)\)", path.read_text())
        if "random_streams" not in path.name and "seed" in argument
    ]
    assert not found


def test_purposes_are_drawn_for_in_one_place_each():
    text = "".join(path.read_text() for path in SOURCES.rglob("*.py"))
    assert not [p.name for p in Purpose if f"Purpose.{p.name}" not in text]


def test_weights_are_drawn_without_a_look_at_any_gpu(monkeypatch):
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 2)
    touched = []
    monkeypatch.setattr(torch.cuda, "get_rng_state", lambda device: touched.append(device))
    monkeypatch.setattr(torch.cuda, "manual_seed_all", lambda seed: touched.append(seed))
    torch.manual_seed(5)
    touched.clear()
    before = torch.default_generator.get_state()
    with seeded(1):
        one = torch.rand(3)
    with seeded(1):
        np.testing.assert_array_equal(torch.rand(3), one)
    assert torch.equal(torch.default_generator.get_state(), before)
    assert touched == []
