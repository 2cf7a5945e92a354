"""What all tests share."""

import pytest
import torch

from simtune.search_param_model.judge import JudgeConfig
from simtune.search_param_model.posterior import PosteriorConfig
from simtune.search_param_model.sight import SightConfig
from simtune.tuning.posterior import PosteriorSearchConfig


@pytest.fixture(autouse=True, scope="session")
def _one_torch_thread():
    """The networks here are tiny: threads would only wait for each other."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


@pytest.fixture(scope="session")
def tiny() -> PosteriorSearchConfig:
    """A posterior search that takes seconds and finds nothing."""
    return PosteriorSearchConfig(
        model=PosteriorConfig(
            sight=SightConfig(channels=4, free_maps=2, hidden=16, batch_size=8),
            judge=JudgeConfig(channels=8, hidden=16, batch_size=8, candidates=8),
        ),
        num_worlds=16,
        episodes_per_world=2,
        filmed_steps=4,
        iterations=2,
        sight_updates=(6, 4),
        judge_updates=5,
    )
