"""Crops and shifts of stacks against slices of each, one after the other."""

import numpy as np
import pytest
import torch

from simtune.agents.augment import centre_crop, crop, random_crop


def stacks(batch: int, num_stacked: int, size: int) -> torch.Tensor:
    """Frames in which no two bytes that lie near each other are the same."""
    shape = (batch, num_stacked, size, size, 3)
    return (torch.arange(np.prod(shape)) * 7919 % 251).to(torch.uint8).reshape(shape)


def generator(seed: int = 3) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def sliced(frames: torch.Tensor, top, left, size: int) -> torch.Tensor:
    cut = [f[:, y : y + size, x : x + size] for f, y, x in zip(frames, top, left, strict=True)]
    return torch.stack(cut)


def test_a_crop_is_a_slice_of_each_stack():
    frames = stacks(5, 3, 10)
    top, left = torch.tensor([0, 4, 2, 0, 4]), torch.tensor([0, 4, 1, 4, 0])
    torch.testing.assert_close(crop(frames, top, left, 6), sliced(frames, top, left, 6))


@pytest.mark.parametrize("of", ["overlapping", "permuted", "whole"])
def test_crops_of_frames_in_any_memory_layout_are_the_same(of):
    seen = stacks(4, 4, 9)
    frames = {
        "overlapping": seen[:, 1:],  # as a replay's next frames
        "permuted": seen.transpose(2, 3),
        "whole": seen,
    }[of]
    top, left = torch.tensor([2, 0, 1, 2]), torch.tensor([1, 2, 0, 2])
    torch.testing.assert_close(crop(frames, top, left, 7), sliced(frames, top, left, 7))


def test_random_crops_are_repeated_by_a_generator_of_the_same_seed():
    frames = stacks(6, 2, 12)
    top, left = (torch.randint(5, (6,), generator=g) for g in [generator()] * 2)
    before = torch.get_rng_state()
    cropped = random_crop(frames, 8, generator())
    torch.testing.assert_close(cropped, sliced(frames, top, left, 8))
    assert torch.equal(torch.get_rng_state(), before)


def test_random_crops_reach_every_place_within_the_picture_and_no_other():
    frames = torch.arange(7 * 7, dtype=torch.uint8).reshape(1, 1, 7, 7, 1).repeat(800, 1, 1, 1, 3)
    corners = random_crop(frames, 5, generator())[:, 0, 0, 0, 0]
    places, counts = corners.unique(return_counts=True)
    assert places.tolist() == [7 * y + x for y in range(3) for x in range(3)]
    assert counts.min() > 800 / 9 / 2


@pytest.mark.parametrize(("size", "cut"), [(6, slice(2, 8)), (5, slice(2, 7)), (10, slice(0, 10))])
def test_a_centre_crop_is_the_middle_of_the_picture(size, cut):
    frames = stacks(2, 3, 10)
    torch.testing.assert_close(centre_crop(frames, size), frames[:, :, cut, cut])


@pytest.mark.parametrize(
    "cut", [lambda f: random_crop(f, 9, generator()), lambda f: centre_crop(f, 9)]
)
def test_a_crop_that_does_not_fit_is_refused(cut):
    with pytest.raises(ValueError, match="frames of 8 × 8 pixels have no crop of 9"):
        cut(stacks(1, 1, 8))


@pytest.mark.gpu
def test_crops_on_a_gpu_are_those_on_a_cpu():
    frames, top, left = stacks(4, 4, 9), torch.tensor([2, 0, 1, 2]), torch.tensor([1, 2, 0, 2])
    cropped = crop(frames.cuda()[:, 1:], top.cuda(), left.cuda(), 7)
    torch.testing.assert_close(cropped.cpu(), sliced(frames[:, 1:], top, left, 7))
