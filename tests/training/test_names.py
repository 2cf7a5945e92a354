"""Names that users choose by: each has what it stands for, and is not taken for another."""

from dataclasses import fields
from pathlib import Path
from typing import Any, get_args

import pytest
from search_context import context_of
from short_training import config_of

from simtune.agents import AGENTS, make_agent
from simtune.config import TuneConfig
from simtune.errors import InputError
from simtune.experiment.search_settings import SearchSettings, choose_search_settings, make_search
from simtune.export.training import module_text
from simtune.names import (
    DEFAULT_SEARCH,
    SEARCHES,
    AgentName,
    ExportFormat,
    SearchName,
    SearchTraits,
    search_traits,
    searches_where,
)
from simtune.tasks import load_task

TASK = load_task("cartpole")
NEW: Any = "a_new_search"
NEW_AGENT: Any = "a_new_agent"
UNUSED: Any = None


def test_every_name_of_a_search_or_an_agent_has_its_line_in_the_table():
    assert set(SEARCHES) == set(get_args(SearchName)), "add a line to SEARCHES in names.py"
    assert set(AGENTS) == set(get_args(AgentName)), "add a line to AGENTS in agents/__init__.py"
    assert DEFAULT_SEARCH in SEARCHES


def test_every_training_library_has_a_module_to_export():
    for library in set(get_args(ExportFormat)) - {"samples"}:
        assert "worlds.npz" in module_text(library)


@pytest.mark.parametrize("name", SEARCHES)
def test_every_search_has_settings_in_tune_and_train(name: SearchName, tmp_path: Path):
    for config in (TuneConfig(task="cartpole", out=tmp_path), config_of(tmp_path)):
        settings = choose_search_settings(config, name, TASK, [], 32)
        assert isinstance(settings, SearchSettings)


@pytest.mark.thorough
@pytest.mark.parametrize("name", SEARCHES)
def test_every_search_is_made_with_the_settings_that_are_chosen_for_it(name: SearchName, tmp_path):
    context = context_of(TASK.simulator(image_size=32))
    config = TuneConfig(task="cartpole", out=tmp_path)
    settings = choose_search_settings(config, name, TASK, [], 32)
    assert make_search(name, context, settings).distribution.space == TASK.parameters


def test_a_search_that_nobody_has_added_is_not_made_as_another_one(tmp_path: Path):
    config = TuneConfig(task="cartpole", out=tmp_path)
    with pytest.raises(AssertionError, match="a_new_search"):
        choose_search_settings(config, NEW, TASK, [], 32)
    settings = choose_search_settings(config, "paper", TASK, [], 32)
    with pytest.raises(AssertionError, match="a_new_search"):
        make_search(NEW, UNUSED, settings)


def test_an_agent_that_nobody_has_added_is_not_made_as_another_one():
    with pytest.raises(KeyError, match="a_new_agent"):
        make_agent(NEW_AGENT, UNUSED)


@pytest.mark.parametrize("name", [None, "a_search_of_another_version"])
def test_nothing_holds_without_a_search_or_for_an_unknown_one(name: str | None):
    nothing = search_traits(name)
    kinds = [f.name for f in fields(SearchTraits) if isinstance(getattr(nothing, f.name), bool)]
    assert len(kinds) == 7
    assert not any(getattr(nothing, kind) for kind in kinds)
    assert not nothing.in_words


def test_refusals_name_the_searches_that_take_an_option(tmp_path: Path, monkeypatch):
    """By the table, so a search with intervals of its own is named, too."""
    config = TuneConfig(task="cartpole", out=tmp_path, search="paper", precision="5%")
    assert searches_where("has_intervals") == "--search posterior"
    with pytest.raises(InputError, match=r"--precision goes with --search posterior$"):
        config.check()
    monkeypatch.setitem(SEARCHES, NEW, SEARCHES["posterior"])
    with pytest.raises(InputError, match=r"with --search posterior or a_new_search$"):
        config.check()
