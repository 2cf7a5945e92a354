"""The fast agent: a teacher's arithmetic, what a student may see, and that it goes on exactly."""

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from simtune.agents import AgentSpec, Observation
from simtune.agents.student import Student, StudentConfig
from simtune.agents.teacher import Teacher, TeacherConfig
from simtune.agents.teacher_student import TeacherStudent
from simtune.agents.teaching_schedule import TeacherStudentConfig, TeachingSchedule
from simtune.api.policy import Policy
from simtune.errors import InputError
from simtune.networks.layers import seeded
from simtune.parameters import ParameterSpace
from simtune.replay_buffer import Episodes, ReplayBuffer, Transitions
from simtune.tasks import load_task
from simtune.vision.detector import DetectorConfig

TASK = load_task("cartpole")
SPACE: ParameterSpace = TASK.parameters
SIZE, STEPS, WORLDS = 32, 6, 4
SMALL = TeacherStudentConfig(
    teacher=TeacherConfig(hidden_size=16, batch_size=8),
    student=StudentConfig(
        detector=DetectorConfig(channels=4, free_maps=1, batch_size=4), hidden_size=16, batch_size=8
    ),
    random_steps=24,
    detector_updates_per_step=(0.1, 0.1),
    teacher_updates_per_step=0.2,
)
SPEC = AgentSpec(
    image_size=SIZE,
    num_stacked=3,
    num_keypoints=2,
    num_states=3,
    num_positions=2,
    num_actions=1,
    privileged=np.arange(len(SPACE)) < 2,
    total_steps=10 * WORLDS * STEPS,
    steps_before_trial=10 * WORLDS * STEPS,
    steps_between_updates=WORLDS * STEPS,
    seed=1,
    device="cpu",
)


def transitions(num: int, seed: int = 0, **changes) -> Transitions:
    g = torch.Generator().manual_seed(seed)
    batch = Transitions(
        states=torch.randn(num, 3, generator=g),
        actions=torch.rand(num, 2, generator=g) * 2 - 1,
        rewards=torch.rand(num, generator=g),
        discounts=torch.ones(num),
        next_states=torch.randn(num, 3, generator=g),
        parameters=torch.rand(num, 1, generator=g),
    )
    return replace(batch, **changes)


def make_teacher(**changes) -> Teacher:
    with seeded(0):
        return Teacher(3, 2, 1, TeacherConfig(hidden_size=32, **changes))


# --- the teacher --------------------------------------------------------------------------


def test_teachers_target_q_equals_hand_calculation():
    teacher = make_teacher(discount=0.9, noise_clip=0.3)
    batch = transitions(2, discounts=torch.tensor([1.0, 0.0]))
    found = teacher.target_q(batch, batch.next_states, 0.5, torch.Generator().manual_seed(7))
    noise = 0.5 * torch.randn(2, 2, generator=torch.Generator().manual_seed(7))
    assert (noise.abs() > 0.3).any()
    actions = (teacher.actor(batch.next_states).tanh() + noise.clamp(-0.3, 0.3)).clamp(-1, 1)
    inputs = torch.cat([batch.next_states, batch.parameters, actions], 1)
    value = torch.minimum(*teacher.targets(inputs))
    expected = batch.rewards.clone()
    expected[0] += 0.9 * value[0]  # the other one ended
    torch.testing.assert_close(found, expected)


def test_target_critics_are_moving_averages():
    teacher = make_teacher(target_rate=0.25)
    slow = [p.clone() for p in teacher.targets.parameters()]
    teacher.update(transitions(16), 0.1, torch.Generator().manual_seed(0))
    for old, now, fast in zip(
        slow, teacher.targets.parameters(), teacher.critics.parameters(), strict=True
    ):
        torch.testing.assert_close(now, 0.75 * old + 0.25 * fast)


def test_critics_are_updated_alike_whatever_the_actor_is():
    """Critics learn from rewards alone, and the actor by nothing but what critics think of it."""
    batch, teacher, other = transitions(16), make_teacher(), make_teacher()
    with torch.no_grad():
        for part in other.actor.parameters():
            part.mul_(0.9)
    for one in (teacher, other):
        one.targets.weights[-1].data.zero_()  # so that target_q are the rewards, whoever acts
        one.update(batch, 0.1, torch.Generator().manual_seed(0))
    for mine, its in zip(teacher.critics.parameters(), other.critics.parameters(), strict=True):
        torch.testing.assert_close(mine, its)


@pytest.mark.parametrize("rounds", [2, 10])
def test_teachers_noise_falls_over_its_share_of_the_training_whenever_the_student_begins(rounds):
    agent = make_agent(rounds * WORLDS * STEPS, noise_share=0.5)  # of 10 · WORLDS · STEPS
    first, last = agent.config.teacher.noise
    noises = []
    for num_steps in (0, 2.5, 5, 8):
        agent.num_steps = round(num_steps * WORLDS * STEPS)
        noises.append(agent.teacher_noise)
    assert noises == pytest.approx([first, (first + last) / 2, last, last])


@pytest.mark.thorough
def test_a_teacher_learns_the_best_actions_of_a_bandit():
    """A bandit: the reward is −(a − ½·s)², so the best action is half the state."""
    teacher, generator = make_teacher(discount=0.0), torch.Generator().manual_seed(0)
    for i in range(1000):
        batch = transitions(64, seed=i)
        wrong = (batch.actions - batch.states[:, :2].clamp(-1.5, 1.5) / 2).square().sum(1)
        teacher.update(replace(batch, rewards=-10 * wrong), 0.1, generator)
    states = torch.tensor([[1.0, -1.0, 0.0], [0.0, 0.5, 2.0]])
    torch.testing.assert_close(teacher.act(states), states[:, :2] / 2, atol=0.15, rtol=0)


@pytest.mark.parametrize(("cost", "returns"), [(0.0, False), (0.01, True)])
def test_a_saturated_actor_returns_only_with_a_saturation_cost(cost, returns):
    teacher = make_teacher(saturation_cost=cost)
    bias = teacher.actor[-1].bias
    torch.nn.init.constant_(bias, 20.0)
    teacher.update(transitions(16), 0.1, torch.Generator().manual_seed(0))
    assert bool((bias < 20).all()) == returns


def test_the_teachers_actor_takes_no_parameters_and_its_critics_do():
    teacher, batch = make_teacher(), transitions(4)
    assert teacher.actor[0].in_features == batch.states.shape[1]
    assert teacher.critics.weights[0].shape[1] == 3 + 1 + 2


# --- the student --------------------------------------------------------------------------


def small_student() -> Student:
    with seeded(0):
        drawn = torch.Generator().manual_seed(0)
        return Student(replace(SPEC, num_positions=1), SMALL.student, drawn)


def dots(num: int, seed: int = 0) -> tuple[torch.Tensor, torch.Tensor]:
    """Pictures of a red and a blue dot, and where those are."""
    rng = np.random.default_rng(seed)
    places = rng.uniform(6, SIZE - 7, (num, 2, 2)).astype(np.float32)
    x, y = np.meshgrid(np.arange(SIZE), np.arange(SIZE))
    frames = np.full((num, SIZE, SIZE, 3), 60, np.uint8)
    for i, pair in enumerate(places):
        for channel, (px, py) in zip((0, 2), pair, strict=True):
            frames[i, np.hypot(x - px, y - py) < 3, channel] = 255
    return torch.from_numpy(frames), torch.from_numpy(places)


@pytest.mark.thorough
def test_a_student_learns_to_detect_dots_and_their_heights():
    student, generator = small_student(), torch.Generator().manual_seed(0)
    frames, places = dots(512)
    for i in range(150):
        at = torch.randint(512, (16,), generator=generator)
        height = (places[at, 0, :1] - 16) / 6  # of a standard deviation of about 1
        student.learn_to_see(frames[at], places[at], height, i / 150)
    unseen, truth = dots(32, seed=1)
    seen = student.detect(unseen)
    found = (seen[:, :4].reshape(-1, 2, 2) + 1) / 2 * SIZE
    assert (found - truth).abs().median() < 0.5  # pixels
    assert (seen[:, -1] - (truth[:, 0, 0] - 16) / 6).abs().median() < 0.3


def test_a_student_that_remembers_pictures_acts_as_one_that_sees_them_anew():
    student, nothing = small_student(), torch.zeros(4, 0)  # no action is late
    film = dots(40)[0].reshape(4, 10, SIZE, SIZE, 3)
    for t in range(8):
        stack = film[:, t : t + 3]
        acted = student.act(stack, nothing)
        student_anew = small_student()
        torch.testing.assert_close(acted, student_anew.act(stack, nothing), rtol=1e-5, atol=1e-6)
    other = film[:, [0, 5, 9]]  # not the next picture: all are looked at
    torch.testing.assert_close(student.act(other, nothing), small_student().act(other, nothing))


def told_to_the_head(student: Student) -> list[torch.Tensor]:
    """Its inputs, which are added as it is called."""
    told: list[torch.Tensor] = []
    student.head.register_forward_pre_hook(lambda _, inputs: told.append(inputs[0]))
    return told


def test_a_head_is_told_where_things_are_and_how_far_they_moved():
    student = small_student()
    told = told_to_the_head(student)
    film = torch.tensor([[[0.0, 0, 0, 0, 0], [0.1, 0, 0, 0, 1], [0.3, 0, 0, 0, 3]]])  # (1, K, F)
    student(film, torch.zeros(1, 0))
    expected = torch.tensor([[0.3, 0, 0, 0, 3], [0.1, 0, 0, 0, 1], [0.2, 0, 0, 0, 2]])
    torch.testing.assert_close(told[0], expected.reshape(1, 15))
    student.standardize_by(torch.cat([film, 3 * film]), torch.zeros(2, 0))  # means: twice the first
    student(2 * film, torch.zeros(1, 0))
    torch.testing.assert_close(told[1], torch.zeros(1, 15), atol=1e-4, rtol=0)


def test_half_a_pixel_beside_what_stands_still_looks_small():
    """A simulated camera never moves; a real one stands a little elsewhere."""
    student = small_student()
    told = told_to_the_head(student)
    still, nothing = torch.zeros(4, 3, 5), torch.zeros(4, 0)
    student.standardize_by(still, nothing)
    student(still + 0.5 * 2 / 64, nothing)  # pictures are 64 pixels wide
    assert 0 < told[0].max() < 1


def test_a_head_learns_from_motions_of_a_fifth_of_a_pixel():
    """It pushes against them. Of what differs least between pictures an action depends most."""
    student, generator = small_student(), torch.Generator().manual_seed(0)
    student.config = replace(student.config, learning_rate=1e-2, warm_up=1)
    nothing = torch.zeros(256, 0)

    def film() -> tuple[torch.Tensor, torch.Tensor]:
        place, speed = torch.randn(2, 256, 1, 5, generator=generator)
        moving = place + 0.2 * 2 / SIZE * speed * torch.arange(3)[:, None]
        return moving, -speed[:, 0, :1].tanh()

    student.standardize_by(film()[0], nothing)
    for _ in range(200):
        seen, wanted = film()
        student.learn_to_act(seen, nothing, wanted, 0.0)
    seen, wanted = film()
    assert (student(seen, nothing) - wanted).abs().mean() < 0.1


def test_a_keypoint_lies_between_its_two_places_by_how_probable_they_are():
    student = small_student()
    places = torch.tensor([[[[8.0, 8], [24, 16]], [[24, 8], [24, 16]]]])  # (1, 2, L, 2) pixels
    probability = torch.tensor([[[0.6, 0.5], [0.2, 0.5]]])
    student.detector.candidates = lambda heatmaps: (places, probability, places)
    seen = student.detect(torch.zeros(1, SIZE, SIZE, 3, dtype=torch.uint8))
    torch.testing.assert_close(seen[0, :4], torch.tensor([12, 8, 24, 16]) / SIZE * 2 - 1)


# --- both together ------------------------------------------------------------------------


def make_agent(steps_before_trial: int = SPEC.steps_before_trial, **changes) -> TeacherStudent:
    return TeacherStudent(
        replace(SPEC, steps_before_trial=steps_before_trial), replace(SMALL, **changes)
    )


def make_replay() -> ReplayBuffer:
    return ReplayBuffer(SPACE, filmed_capacity=50, unfilmed_capacity=50)


def episodes(seed: int, filmed: bool) -> Episodes:
    rng = np.random.default_rng(seed)
    shape = (WORLDS, STEPS)
    frames, places = dots(WORLDS * (STEPS + 1), seed)
    pictures = frames.numpy().reshape(WORLDS, STEPS + 1, SIZE, SIZE, 3)
    return Episodes(
        parameters=np.tile(SPACE.nominal, (WORLDS, 1)),
        full_states=np.zeros((WORLDS, STEPS + 1, 2)),
        states=rng.normal(size=(WORLDS, STEPS + 1, 3)).astype(np.float32),
        actions=rng.uniform(-1, 1, (*shape, 1)).astype(np.float32),
        rewards=rng.uniform(size=shape).astype(np.float32),
        lengths=np.full(WORLDS, STEPS),
        terminated=np.zeros(WORLDS, bool),
        frames=pictures if filmed else None,
        keypoints=places.numpy().reshape(WORLDS, STEPS + 1, 2, 2) if filmed else None,
    )


def go_on(agent: TeacherStudent, replay: ReplayBuffer, rounds: range) -> list[dict[str, float]]:
    losses = []
    for seed in rounds:
        replay.add(episodes(seed, agent.wants_frames))
        losses.append(agent.update(replay, WORLDS * STEPS))
    return losses


def test_the_teacher_is_first_and_then_they_take_turns():
    agent, replay = make_agent(teacher_share=0.4, filmed_share=0.5), make_replay()
    looks = []
    for seed in range(10):
        looks.append(agent.wants_frames)
        go_on(agent, replay, range(seed, seed + 1))
    assert looks == [False] * 5 + [True, False, True, False, True]


@pytest.mark.parametrize("rounds", [1.5, 2, 2.5, 4, 5, 5.2, 10])
def test_the_student_can_act_by_the_first_real_episode(rounds):
    steps_before_trial = round(rounds * WORLDS * STEPS)
    agent, replay = make_agent(steps_before_trial), make_replay()
    while agent.num_steps < steps_before_trial:
        assert not agent.can_act or rounds > 5  # late, since its teacher is to know something
        go_on(agent, replay, range(1))
    assert agent.can_act


def test_the_teacher_acts_until_the_student_can():
    agent, replay = make_agent(random_steps=0, filmed_noise=0.0), make_replay()
    go_on(agent, replay, range(10))
    filmed = episodes(0, True)
    seen = Observation(filmed.states[:, 0], filmed.frames[:, :3])
    best, own = agent.teacher.act(torch.from_numpy(seen.state)).numpy(), agent.act(seen.frames)
    assert (np.abs(best - own) > 1e-4).all()
    for filmed_rounds, expected in ((0, best), (1, own)):  # a tenth of ten rounds
        agent.load(agent.tensors(), agent.state() | {"num_filmed": filmed_rounds * WORLDS * STEPS})
        np.testing.assert_allclose(agent.explore(seen, replay), expected, atol=1e-6)


def test_noise_grows_from_one_filmed_world_to_the_next():
    agent, replay = make_agent(random_steps=0, filmed_noise=0.2), make_replay()
    go_on(agent, replay, range(10))
    agent.load(agent.tensors(), agent.state() | {"num_filmed": WORLDS * STEPS})
    filmed = episodes(0, True)
    seen = Observation(filmed.states[:, 0], filmed.frames[:, :3])
    own = agent.act(seen.frames)
    assert np.abs(own).max() < 0.5  # far from ±1, where noise would be cut off
    away = np.stack([agent.explore(seen, replay) for _ in range(500)]) - own
    expected = 0.2 * np.linspace(0, 1, WORLDS) ** 2
    np.testing.assert_allclose(away.std(0)[:, 0], expected, rtol=0.15, atol=1e-6)


def test_losses_have_the_same_names_in_every_round():
    taught, studied = make_agent(teacher_share=0.1), make_replay()
    losses = go_on(taught, studied, range(4))
    names = {"loss/critic", "loss/actor", "loss/detector", "loss/imitation"}
    assert all(set(told) == names for told in losses)
    assert math.isnan(losses[0]["loss/detector"])
    assert math.isfinite(losses[0]["loss/critic"])
    assert math.isfinite(losses[-1]["loss/imitation"])


def test_the_policy_acts_without_the_teachers_networks():
    agent, replay = make_agent(), make_replay()
    go_on(agent, replay, range(6))
    frames = episodes(9, True).frames[:, :3]
    acted = agent.act(frames)
    for part in (agent.teacher.actor, agent.teacher.critics):
        for weights in part.parameters():
            weights.data.fill_(torch.nan)  # nothing that needs the state can answer
    np.testing.assert_array_equal(agent.act(frames), acted)
    assert np.ptp(agent.act(episodes(10, True).frames[:, :3]) - acted) > 0


def test_an_agent_whose_actions_may_be_late_knows_its_latest_ones():
    """In the real world by what it did itself; as an episode begins it has done nothing."""
    spec = replace(SPEC, max_delay_steps=2, num_states=3 + 2)
    agent, told = TeacherStudent(spec, SMALL), []
    act = agent.student.act

    def spy(frames: torch.Tensor, latest: torch.Tensor) -> torch.Tensor:
        told.append(latest)
        return act(frames, latest)

    agent.student.act = spy
    film = np.random.default_rng(0).integers(0, 255, (2, 4, SIZE, SIZE, 3), np.uint8)
    stacks = [film[:, np.maximum(np.arange(t - 2, t + 1), 0)] for t in range(4)]
    acted = [agent.act(stack) for stack in stacks]
    agent.begin_episodes()
    agent.act(stacks[0])
    zero = np.zeros((2, 1))
    expected = [(zero, zero), (acted[0], zero), (acted[1], acted[0]), (acted[2], acted[1])]
    for latest, pair in zip(told, [*expected, (zero, zero)], strict=True):
        np.testing.assert_array_equal(latest, np.hstack(pair))
    seen = Observation(np.arange(10, dtype=np.float32).reshape(2, 5), stacks[2])
    agent.num_steps = SMALL.random_steps
    agent.explore(seen, make_replay())  # in simulation the state has them
    np.testing.assert_array_equal(told[-1], [[3, 4], [8, 9]])


def test_an_agent_knows_its_latest_actions_where_nothing_moves():
    agent, told = TeacherStudent(replace(SPEC, max_delay_steps=1, num_states=3 + 1), SMALL), []
    act = agent.student.act

    def spy(frames: torch.Tensor, latest: torch.Tensor) -> torch.Tensor:
        told.append(latest.tolist())
        return act(frames, latest)

    agent.student.act = spy
    still = np.full((2, 3, SIZE, SIZE, 3), 7, np.uint8)
    acted = [agent.act(still).tolist() for _ in range(3)]
    assert told == [[[0], [0]], acted[0], acted[1]]
    assert acted[0] != [[0], [0]]


def test_an_episode_may_begin_in_the_picture_that_the_last_one_ended_in(monkeypatch):
    spec = replace(SPEC, max_delay_steps=2, num_states=3 + 2)
    simulator = SimpleNamespace(action_mapping=TASK.load_actions())
    trained = SimpleNamespace(
        agent=TeacherStudent(spec, SMALL),
        task=TASK,
        schedule=SimpleNamespace(num_stacked=3, image_size=SIZE),
        learnt_in=SimpleNamespace(simulator=simulator),
    )
    monkeypatch.setattr("simtune.api.policy.load_trained", lambda _: trained)
    policy = Policy(Path("run"))
    picture, acted = np.full((SIZE, SIZE, 3), 7, np.uint8), []
    for _ in range(3):
        policy.reset()
        acted.append([policy.act(picture).tolist() for _ in range(4)])
    assert acted[1:] == acted[:1] * 2
    assert acted[0][0] != acted[0][1]  # what it did counts within an episode


def test_a_training_of_a_single_step_has_one_round():
    agent = TeacherStudent(replace(SPEC, total_steps=1, steps_before_trial=1), SMALL)
    first, second = go_on(agent, make_replay(), range(2))
    assert math.isfinite(first["loss/critic"])
    assert math.isfinite(second["loss/imitation"])


def test_a_single_filmed_world_has_any_noise():
    agent = make_agent()
    drawn = [float(agent._filmed_noise(1)) for _ in range(200)]
    assert min(drawn) < 0.001
    assert max(drawn) > 0.38


def test_exploring_without_pictures_acts_on_the_state():
    agent = make_agent(random_steps=0)
    states = np.random.default_rng(0).normal(size=(WORLDS, 3)).astype(np.float32)
    acted = agent.explore(Observation(states, None), make_replay())
    assert acted.shape == (WORLDS, 1)
    assert (np.abs(acted) <= 1).all()


def test_a_checkpoint_of_other_network_sizes_is_refused():
    wider = make_agent(teacher=TeacherConfig(hidden_size=17, batch_size=8))
    with pytest.raises(InputError, match="another teacher than this version"):
        make_agent().load(wider.tensors(), wider.state())


@pytest.mark.parametrize("before", [2, 6])
def test_a_resumed_agent_repeats_a_straight_one_bit_for_bit(before):
    straight, interrupted = make_agent(), make_agent()
    replay, other = make_replay(), make_replay()
    go_on(straight, replay, range(before))
    go_on(interrupted, other, range(before))
    resumed = make_agent()
    resumed.load({k: v.clone() for k, v in interrupted.tensors().items()}, interrupted.state())
    then = (go_on(straight, replay, range(before, 10)), go_on(resumed, other, range(before, 10)))
    np.testing.assert_equal(*then)
    for (name, a), b in zip(straight.tensors().items(), resumed.tensors().values(), strict=True):
        torch.testing.assert_close(a, b, rtol=0, atol=0, msg=name)
    assert straight.state() == resumed.state()


@pytest.mark.parametrize(
    ("detector_updates", "expected"), [(1, 0.05), (10**6, 0.2), (45, 45 / (0.5 * 900))]
)
def test_short_trainings_learn_to_see_in_more_updates_a_step(detector_updates, expected):
    spec = replace(SPEC, total_steps=1000, steps_before_trial=200, steps_between_updates=10)
    shares = {"teacher_share": 0.5, "filmed_share": 0.5}  # begins at 100, then films every other
    rates = {"detector_updates_per_step": (0.05, 0.2), "detector_updates": detector_updates}
    schedule = TeachingSchedule.of(replace(SMALL, **shares, **rates), spec)
    assert schedule.detector_updates_per_step == pytest.approx(expected)
