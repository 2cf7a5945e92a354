"""The replay against one that stores a stack of frames twice for every step."""

from collections import deque
from dataclasses import fields, replace

import numpy as np
import pytest
import torch

from simtune.parameters import Parameter, ParameterSpace
from simtune.replay_buffer import Episodes, EpisodeStore, ReplayBuffer, Transitions
from simtune.run import checkpoint
from simtune.search_param_model.windows import SpmBuffer
from simtune.simulation import Rollouts, StrayLight

STEPS, SIZE = 7, 6
SPACE = ParameterSpace(
    [
        Parameter(name="mass", field="opt.o", nominal=1.0, low=0.1, high=10.0, unit="kg"),
        Parameter(
            name="red", field="opt.o", nominal=0.5, low=0.0, high=1.0, scale="linear", unit="1"
        ),
    ]
)


def draw(states: np.ndarray, parameters: np.ndarray, size: int = SIZE) -> np.ndarray:
    """Pictures that tell states and worlds apart; the simulator's `render`."""
    noise = np.sin(1000 * states[:, 0] + parameters[:, 0])[:, None] + np.arange(size * size * 3)
    return (noise * 1e4 % 256).astype(np.uint8).reshape(-1, size, size, 3)


def some(
    lengths: list[int],
    *,
    seed: int = 0,
    filmed: bool = True,
    steps: int = STEPS,
    size: int = SIZE,
    full_states: int = 5,
    states: int = 4,
    actions: int = 2,
) -> Episodes:
    """Episodes of these lengths; after their ends only what nobody may read."""
    rng = np.random.default_rng(seed)
    n = len(lengths)
    parameters = SPACE.from_unit(rng.uniform(size=(n, 2)))
    arrays = {
        "full_states": rng.normal(size=(n, steps + 1, full_states)),
        "states": rng.normal(size=(n, steps + 1, states)).astype(np.float32),
        "actions": rng.uniform(-1, 1, (n, steps, actions)).astype(np.float32),
        "rewards": rng.uniform(size=(n, steps)).astype(np.float32),
    }
    frames = None
    if filmed:
        of_each = np.repeat(parameters, steps + 1, axis=0)
        frames = draw(arrays["full_states"].reshape(-1, full_states), of_each, size)
        frames = frames.reshape(n, steps + 1, size, size, 3)
    for i, length in enumerate(lengths):
        for array in arrays.values():
            array[i, length + array.shape[1] - steps :] = np.nan
        if frames is not None:
            frames[i, length + 1 :] = 255
    return Episodes(
        parameters=parameters,
        lengths=np.array(lengths),
        terminated=rng.uniform(size=n) < 0.5,
        frames=frames,
        **arrays,
    )


class NaiveReplay:
    """A list of steps for each slot, and each step with stacks of its own, of 3 frames."""

    def __init__(self, capacity: int):
        self.slots: list[list[Transitions]] = [[] for _ in range(capacity)]
        self.num_added = 0

    def add(self, episodes: Episodes) -> None:
        for i in range(len(episodes)):
            self.slots[self.num_added % len(self.slots)] = self._steps(episodes, i)
            self.num_added += 1

    def _steps(self, episodes: Episodes, i: int) -> list[Transitions]:
        unit = torch.as_tensor(SPACE.to_unit(episodes.parameters[i]), dtype=torch.float32)
        stack, steps = None, []
        if episodes.frames is not None:
            stack = deque([episodes.frames[i, 0]] * 3, maxlen=3)
        for t in range(episodes.lengths[i]):
            frames = next_frames = None
            if stack is not None:
                frames = torch.as_tensor(np.stack(stack))
                stack.append(episodes.frames[i, t + 1])
                next_frames = torch.as_tensor(np.stack(stack))
            is_end = episodes.terminated[i] and t == episodes.lengths[i] - 1
            step = Transitions(
                states=torch.as_tensor(episodes.states[i, t]),
                actions=torch.as_tensor(episodes.actions[i, t]),
                rewards=torch.as_tensor(episodes.rewards[i, t]),
                discounts=torch.tensor(0.0 if is_end else 1.0),
                next_states=torch.as_tensor(episodes.states[i, t + 1]),
                parameters=unit,
                frames=frames,
                next_frames=next_frames,
            )
            steps.append(step)
        return steps

    @property
    def steps(self) -> list[Transitions]:
        return [step for slot in self.slots for step in slot]


def stacked(steps: list[Transitions], with_frames: bool) -> Transitions:
    names = [f.name for f in fields(Transitions) if with_frames or "frames" not in f.name]
    return Transitions(**{name: torch.stack([getattr(s, name) for s in steps]) for name in names})


def assert_same(one: Transitions, other: Transitions) -> None:
    for field in fields(Transitions):
        a, b = getattr(one, field.name), getattr(other, field.name)
        assert (a is None) == (b is None), field.name
        if a is not None:
            assert a.dtype == b.dtype, field.name
            assert torch.equal(a, b), field.name


def generator(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def test_batches_are_those_of_a_replay_of_stacks():
    replay = ReplayBuffer(SPACE, filmed_capacity=5, unfilmed_capacity=4)
    filmed, unfilmed = NaiveReplay(5), NaiveReplay(4)
    assorted = [[7, 3, 1], [2, 7], [5, 5, 6], [1, 7]]  # 10 episodes into 5 slots, then into 4
    for seed, lengths in enumerate(assorted):
        for naive in (filmed, unfilmed):
            episodes = some(lengths, seed=2 * seed + (naive is filmed), filmed=naive is filmed)
            replay.add(episodes)
            naive.add(episodes)
        for with_frames in (True, False):
            steps = filmed.steps if with_frames else filmed.steps + unfilmed.steps
            assert len(steps) == (replay.num_filmed_steps if with_frames else replay.num_steps)
            share = torch.rand(400, generator=generator(seed), dtype=torch.float64)
            index = (share * len(steps)).long()
            expected = stacked([steps[i] for i in index], with_frames)
            assert_same(replay.sample(400, generator(seed), with_frames), expected)


@pytest.mark.parametrize("num_stacked", [1, 4])
def test_stacks_stay_within_their_episode(num_stacked):
    replay = ReplayBuffer(SPACE, filmed_capacity=2, num_stacked=num_stacked)
    episodes = some([7, 7])
    episodes.frames[...] = np.arange(16).reshape(2, 8, 1, 1, 1)  # when, and which episode
    episodes.rewards[...] = np.arange(14).reshape(2, 7)
    replay.add(episodes)
    batch = replay.sample(500, generator(), with_frames=True)
    assert batch.frames is not None
    assert batch.next_frames is not None
    episode, t = batch.rewards.int() // 7, batch.rewards.int() % 7
    offsets = torch.arange(1 - num_stacked, 1)
    for frames, now in ((batch.frames, t), (batch.next_frames, t + 1)):
        assert frames.shape == (500, num_stacked, SIZE, SIZE, 3)
        expected = 8 * episode[:, None] + (now[:, None] + offsets).clamp(min=0)
        assert torch.equal(frames[..., 0, 0, 0].int(), expected.int())


def test_discount_is_zero_only_where_the_task_ended():
    replay = ReplayBuffer(SPACE, filmed_capacity=0, unfilmed_capacity=4)
    episodes = some([7, 4, 7, 4], filmed=False)  # a short one that did not end has diverged
    episodes.rewards[...] = np.arange(28).reshape(4, 7)
    replay.add(replace(episodes, terminated=np.array([True, True, False, False])))
    batch = replay.sample(500, generator(), with_frames=False)
    ended = batch.rewards[batch.discounts == 0]
    assert set(ended.tolist()) == {6.0, 7.0 + 3.0}
    assert set(batch.discounts.tolist()) == {0.0, 1.0}


def test_every_step_is_as_likely_as_any_other():
    replay = ReplayBuffer(SPACE, filmed_capacity=3, unfilmed_capacity=2)
    for filmed, lengths, first in ((True, [7, 1, 4], 0), (False, [2, 5], 12)):
        episodes, ids = some(lengths, filmed=filmed), np.arange(first, first + 12)
        for i, length in enumerate(lengths):
            episodes.rewards[i, :length], ids = ids[:length], ids[length:]
        replay.add(episodes)
    for with_frames, num in ((True, 12), (False, 19)):
        batch = replay.sample(2000 * num, generator(), with_frames)
        counts = torch.bincount(batch.rewards.int(), minlength=num)
        assert len(counts) == num
        assert (counts - 2000).abs().max() < 5 * 2000**0.5


def test_empty_episodes_are_not_stored_and_of_too_many_only_the_last():
    replay = ReplayBuffer(SPACE, filmed_capacity=3)
    episodes = some([7, 0, 6, 5, 4])
    replay.add(episodes)
    assert replay.num_added == 4
    assert replay.lengths.tolist() == [6, 5, 4]
    assert torch.equal(replay.parameters, torch.as_tensor(episodes.parameters[2:]))
    replay.add(some([0, 0]))
    assert (replay.num_added, len(replay)) == (4, 3)


def test_a_replay_resumed_from_a_checkpoint_repeats_its_batches_bit_for_bit(tmp_path):
    def start() -> ReplayBuffer:
        return ReplayBuffer(SPACE, filmed_capacity=10, unfilmed_capacity=4)  # one stays empty

    asked = []

    def film(states: np.ndarray, parameters: np.ndarray, stray: StrayLight) -> np.ndarray:
        assert np.isfinite(states).all()
        assert not stray.to_rows().any()
        asked.append(len(states))
        return draw(states, parameters)

    straight = start()
    for seed in range(3):
        straight.add(some([7, 3, 1], seed=seed))
        straight.add(some([2, 7], seed=seed, filmed=False))
    path = checkpoint.save(tmp_path, straight.tensors(), straight.state())
    assert not any("frames" in name for name in straight.tensors())
    resumed = start()
    resumed.load(*checkpoint.load(path), film)
    filmed = straight.lengths[:10]
    assert asked == (filmed[filmed > 0] + 1).tolist()  # an episode at a time
    for seed in range(3):
        for with_frames in (True, False):
            batch = straight.sample(300, generator(seed), with_frames)
            assert_same(resumed.sample(300, generator(seed), with_frames), batch)
        for replay in (straight, resumed):
            replay.add(some([7, 6], seed=seed + 10))
            replay.add(some([6], seed=seed + 10, filmed=False))
        for name, array in straight.tensors().items():
            np.testing.assert_array_equal(array, resumed.tensors()[name])
    assert straight.state() == resumed.state()


def test_frames_are_drawn_again_in_the_light_of_their_rooms():
    stray = StrayLight.draw(3, np.random.default_rng(0))
    for one, other in zip(StrayLight.from_rows(stray.to_rows()), stray, strict=True):
        np.testing.assert_array_equal(one, other)
    store, resumed = (ReplayBuffer(SPACE, filmed_capacity=3) for _ in range(2))
    store.add(replace(some([7, 0, 3]), stray=stray.to_rows()))  # the second one is not stored
    store.add(some([5]))  # of no room: another simulator's own pictures
    seen = []

    def film(states: np.ndarray, parameters: np.ndarray, light: StrayLight) -> np.ndarray:
        seen.append(light.to_rows())
        return draw(states, parameters)

    resumed.load(store.tensors(), store.state(), film)
    lights = stray.of(np.array([0, 2])).to_rows()
    expected = [lights[[0] * 8], lights[[1] * 4], np.zeros((6, 6))]
    for one, other in zip(seen, expected, strict=True):
        np.testing.assert_array_equal(one, other)


def test_an_empty_store_can_be_saved():
    store, other = (EpisodeStore(SPACE, filmed_capacity=2) for _ in range(2))
    other.add(some([7, 7]))
    other.load(store.tensors(), store.state(), draw)
    assert (len(other), other.num_added) == (0, 0)


def bytes_of(thing: object) -> int:
    """All arrays that hang on an object."""
    arrays = (v for v in vars(thing).values() if isinstance(v, torch.Tensor | np.ndarray))
    return sum(array.nbytes for array in arrays)


class BytesOfStacks:
    """What the authors' code keeps for each step: obs and next_obs, 9 channels each."""

    def __init__(self, num_steps: int, size: int, num_states: int, num_actions: int):
        self.obs = np.empty((num_steps, 9, size, size), np.uint8)
        self.next_obs = np.empty((num_steps, 9, size, size), np.uint8)
        self.states = np.empty((num_steps, num_states), np.float32)
        self.next_states = np.empty((num_steps, num_states), np.float32)
        self.actions = np.empty((num_steps, num_actions), np.float32)
        self.rewards = np.empty(num_steps, np.float32)
        self.discounts = np.empty(num_steps, np.float32)
        self.parameters = np.empty((num_steps, len(SPACE)), np.float32)


@pytest.mark.parametrize("size", [64, 84, 100])
def test_memory_is_a_sixth_for_an_agent_and_a_twelfth_for_both(size):
    like_walker = {"steps": 200, "size": size, "states": 24, "actions": 6, "full_states": 91}
    replay = ReplayBuffer(SPACE, filmed_capacity=2)
    replay.add(some([200, 200], **like_walker))
    buffer = SpmBuffer(replay, np.ones(6))
    of_agent = BytesOfStacks(400, size, 24, 6)
    of_spm = BytesOfStacks(400, size, 24, 6)
    pictures = (of_agent.obs.nbytes + of_agent.next_obs.nbytes) / replay.frames.nbytes
    assert pictures == pytest.approx(6 * 200 / 201)
    everything = bytes_of(of_agent) / bytes_of(replay)
    shared = (bytes_of(of_agent) + bytes_of(of_spm)) / (bytes_of(replay) + bytes_of(buffer))
    assert everything > 5.5  # the full states are what is added
    assert shared > 11


def test_windows_and_transitions_are_of_the_same_frames():
    replay = ReplayBuffer(SPACE, filmed_capacity=3, unfilmed_capacity=1)
    buffer = SpmBuffer(replay, np.ones(2))
    replay.add(some([7]))
    place = replay.frames.data_ptr()
    replay.add(some([7, 7]))
    replay.add(some([7], filmed=False))
    assert buffer.store.frames.data_ptr() == replay.frames.data_ptr() == place
    replay.frames[:] = 123
    windows, _ = buffer.sample(4, 3, SIZE, np.random.default_rng(0))
    batch = replay.sample(4, generator(), with_frames=True)
    assert batch.frames is not None
    assert (windows.frames == 123).all()
    assert (batch.frames == 123).all()


def test_windows_never_span_two_episodes():
    replay = ReplayBuffer(SPACE, filmed_capacity=4, unfilmed_capacity=1)
    buffer = SpmBuffer(replay, np.array([4.0, 1.0]))
    for first in (0, 3):  # the last two take the places of the first two
        ids = np.arange(first, first + 3)
        episodes = some([7, 7, 4 if first else 5])
        episodes.frames[..., 0] = ids[:, None, None, None]
        episodes.frames[..., 1] = np.arange(8)[:, None, None]
        episodes.parameters[:, 0] = ids
        episodes.actions[...] = (np.arange(7) + 10 * ids[:, None])[..., None] / 64
        replay.add(episodes)
    replay.add(some([7], filmed=False))
    windows, truth = buffer.sample(600, 5, SIZE, np.random.default_rng(0))
    ids, times = windows.frames[..., 0, 0, 0].numpy(), windows.frames[..., 0, 0, 1].numpy()
    assert (ids == truth[:, :1]).all()
    starts = {int(i): set(times[truth[:, 0] == i, 0].tolist()) for i in set(truth[:, 0])}
    assert starts == {2: {0}, 3: {0, 1, 2}, 4: {0, 1, 2}}  # the fifth is too short
    assert (times == times[:, :1] + np.arange(5)).all()
    scaled = (times + 10.0 * ids)[..., None] / 64 * np.array([4.0, 1.0])
    np.testing.assert_array_equal(windows.actions, scaled)


def test_crops_are_random_but_the_same_within_a_window():
    store = EpisodeStore(SPACE, filmed_capacity=1)
    episodes = some([7], size=20)
    picture = np.arange(400).reshape(20, 20)
    episodes.frames[...] = np.stack([picture % 256, picture // 256, picture * 0], -1)
    store.add(episodes)
    windows, _ = SpmBuffer(store, np.ones(2)).sample(400, 3, 16, np.random.default_rng(0))
    assert (windows.frames == windows.frames[:, :1]).all()
    corners = windows.frames[:, 0, 0, 0].int()
    assert len(set((corners[:, 0] + 256 * corners[:, 1]).tolist())) == 25


def test_rollouts_become_episodes_without_rewards():
    rng = np.random.default_rng(0)
    actions = rng.uniform(-4, 4, (2, STEPS, 2))
    states = rng.normal(size=(2, STEPS + 1, 5))
    of_all = (np.full(2, STEPS), np.empty((2, STEPS + 1, 0)), np.arange(2))
    rollouts = Rollouts(rng.uniform(size=(2, 2)), states, actions, *of_all)
    frames = np.zeros((2, STEPS + 1, SIZE, SIZE, 3), np.uint8)
    episodes = Episodes.unrewarded(
        rollouts, np.array([4.0, 1.0]), frames, np.ones((2, STEPS + 1, 3))
    )
    np.testing.assert_array_equal(episodes.actions * [4.0, 1.0], actions)
    assert episodes.states.shape == (2, STEPS + 1, 3)
    assert not episodes.rewards.any()
    assert not episodes.terminated.any()
    assert episodes.lengths.tolist() == [STEPS, STEPS]


def test_episodes_that_do_not_fit_together_are_refused():
    episodes = some([7, 3])
    with pytest.raises(ValueError, match=r"2 episodes of 7 steps .* states of shape \(2, 8, D\)"):
        replace(episodes, states=episodes.states[:, 1:])
    with pytest.raises(ValueError, match=r"frames of shape \(2, 8, H, W, 3\), got \(2, 8, 6, 6\)"):
        replace(episodes, frames=episodes.frames[..., 0])
    with pytest.raises(ValueError, match=r"rewards must be \(n, T\), got \(2,\)"):
        replace(episodes, rewards=episodes.rewards[:, 0])
    with pytest.raises(ValueError, match="frames must be uint8, got float32"):
        replace(episodes, frames=episodes.frames.astype(np.float32))
    with pytest.raises(ValueError, match=r"lengths must lie in \[0, 7\], got \[7 8\]"):
        replace(episodes, lengths=np.array([7, 8]))


def test_a_replay_refuses_what_it_cannot_store_or_sample():
    replay = ReplayBuffer(SPACE, filmed_capacity=2)
    with pytest.raises(ValueError, match="no episode is stored; add some"):
        replay.sample(3, generator(), with_frames=False)
    with pytest.raises(ValueError, match="make the store with unfilmed_capacity"):
        replay.add(some([7], filmed=False))
    replay.add(some([4]))
    kept = {name: array.clone() for name, array in replay.tensors().items()}
    with pytest.raises(ValueError, match=r"states of an episode must be \[8, 4\] as at first"):
        replay.add(some([7], states=5))
    with pytest.raises(ValueError, match=r"frames of an episode .* got \[8, 9, 9, 3\]"):
        replay.add(some([7], size=9))
    for name, array in replay.tensors().items():
        np.testing.assert_array_equal(array, kept[name])  # as it was; after the end is NaN
    with pytest.raises(ValueError, match="no filmed episode of at least 5 steps is stored"):
        SpmBuffer(replay, np.ones(2)).sample(3, 5, SIZE, np.random.default_rng(0))
    other = ReplayBuffer(SPACE, filmed_capacity=3)
    with pytest.raises(ValueError, match="saved with filmed_capacity=2, got 3"):
        other.load(replay.tensors(), replay.state(), draw)
    teacher = ReplayBuffer(SPACE, filmed_capacity=1, unfilmed_capacity=1)
    teacher.add(some([7], filmed=False))
    with pytest.raises(ValueError, match="no filmed episode is stored"):
        teacher.sample(3, generator(), with_frames=True)


@pytest.mark.gpu
def test_a_batch_never_waits_for_the_host():
    replay, naive = ReplayBuffer(SPACE, filmed_capacity=3, device="cuda"), NaiveReplay(3)
    for kept in (replay, naive):
        kept.add(some([7, 2, 5]))
    drawn = torch.Generator("cuda").manual_seed(0)
    replay.sample(64, drawn, with_frames=True)  # what is loaded once
    torch.cuda.set_sync_debug_mode("error")
    try:
        batch = replay.sample(64, drawn, with_frames=True)
    finally:
        torch.cuda.set_sync_debug_mode("default")
    arrays = {f.name: getattr(batch, f.name).cpu() for f in fields(Transitions)}
    by_reward = {float(step.rewards): step for step in naive.steps}
    expected = stacked([by_reward[r] for r in arrays["rewards"].tolist()], with_frames=True)
    assert_same(Transitions(**arrays), expected)


def test_a_draw_is_split_into_batches_and_a_rest():
    drawn = Transitions(
        states=torch.arange(14.0).reshape(7, 2),
        actions=torch.arange(7.0)[:, None],
        rewards=torch.arange(7.0),
        discounts=torch.ones(7),
        next_states=torch.zeros(7, 2),
        parameters=torch.zeros(7, 1),
    )
    parts = list(drawn.split(3))
    assert [part.rewards.tolist() for part in parts] == [[0, 1, 2], [3, 4, 5], [6]]
    assert all(part.frames is None for part in parts)
    assert torch.equal(torch.cat([part.states for part in parts]), drawn.states)
