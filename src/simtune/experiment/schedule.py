"""When things happen in a training: the presets, and what depends on the task."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Schedule:
    """Algorithm 1's numbers. A cycle: film the real world, search, train the policy.

    Steps are policy steps in simulation, after action repeat.
    """

    pretrain_steps: int  # around the start, before the real world is filmed
    policy_steps: tuple[int, ...]  # of each cycle's policy phase
    searches: tuple[int, ...]  # rounds of the search before each of them
    real_episodes: tuple[int, ...]  # by random actions in the first cycle, then by the policy
    num_worlds: int  # in which the policy acts at once
    image_size: int  # side of drawn pictures in pixels
    num_stacked: int = 3  # frames that the policy sees, appendix
    filmed_steps: int = 60_000  # the latest, whose frames are kept

    @property
    def total_steps(self) -> int:
        return self.pretrain_steps + sum(self.policy_steps)

    @property
    def steps_before_trial(self) -> int:
        """Policy steps before the policy's first trial in the real world."""
        return self.pretrain_steps or self.policy_steps[0]

    def steps_after(self, cycle: int) -> int:
        """Policy steps at the end of a cycle."""
        return self.pretrain_steps + sum(self.policy_steps[: cycle + 1])


def fast(
    total_steps: int,
    real_episodes: int,
    tried_episodes: int | None = None,
    *,
    pretrain_steps: int = 0,
    many_searches: bool,
) -> Schedule:
    """Minutes on two CPU cores: the real world is filmed once more, with the policy, if need be.

    `many_searches`: the search takes small steps, so there are many rounds.
    """
    tuned = total_steps - pretrain_steps
    return Schedule(
        pretrain_steps=pretrain_steps,
        policy_steps=(tuned // 2, tuned - tuned // 2),
        searches=(20, 20) if many_searches else (1, 1),
        real_episodes=(real_episodes, 2 if tried_episodes is None else tried_episodes),
        num_worlds=16,
        image_size=64,
    )


def paper(
    total_steps: int,
    real_episodes: int,
    tried_episodes: int | None = None,
    *,
    pretrain_steps: int = 0,
    many_searches: bool,
) -> Schedule:
    """As the authors ran it: 40k policy steps, then 10k steps of the SPM, and again.

    Their SPM phases are five updates of ξ_mean each, from five real episodes an update.
    """
    tuned = total_steps - pretrain_steps
    cycles = max(1, tuned // 40_000)
    moves = 5 if many_searches else 1
    # Their "pretrain" and "update" phases, before any policy is trained: 25 rounds that move
    # nothing (`PaperConfig.pretrain_steps`), 40 that do.
    first = 65 if many_searches else 1
    later = real_episodes if tried_episodes is None else tried_episodes
    return Schedule(
        pretrain_steps=pretrain_steps,
        policy_steps=(tuned // cycles,) * cycles,
        searches=(first,) + (moves,) * (cycles - 1),
        real_episodes=(real_episodes,) + (later,) * (cycles - 1),
        num_worlds=1,
        image_size=100,
        filmed_steps=100_000,  # as in their replay
    )


SCHEDULES = {"fast": fast, "paper": paper}
PAPER_STEPS = 500_000  # theirs are 247k to 497k, read off their plots
