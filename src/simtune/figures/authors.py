"""Results of the paper's authors, for comparison with ours: data only.

Source: the plots of Du, Watkins, Darrell, Abbeel and Pathak, "Auto-Tuned Sim-to-Real Transfer"
(ICRA 2021), digitised to a pixel: means and standard deviations over three seeds at the ends of the
curves, in a pseudo-real world, with 200 policy steps per episode. The robot's tasks are scored by
success, the others by return. The authors' oracle of cheetah was trained in another model than it
was scored in.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class EndPoint:
    """End of a method's curve."""

    mean: float
    std: float | None = None  # over seeds


@dataclass(frozen=True)
class Reached:
    """The authors' results in a task."""

    policy_steps: int
    score: str  # "return", or "success" as a share of episodes
    methods: dict[str, EndPoint]
    percent_error: tuple[float, float] | None  # of ξ_mean, at the start and at the end


AUTHORS = {
    "ball_in_cup": Reached(
        248_000,
        "return",
        {"oracle": EndPoint(719, 8), "autotune": EndPoint(337, 176), "dr": EndPoint(100, 10)},
        (60, 33),
    ),
    "walker": Reached(
        497_000,
        "return",
        {"oracle": EndPoint(261, 27), "autotune": EndPoint(132, 3), "dr": EndPoint(47, 26)},
        (64, 7),
    ),
    "cheetah": Reached(
        247_000,
        "return",
        {"oracle": EndPoint(166, 56), "autotune": EndPoint(263, 56), "dr": EndPoint(111, 71)},
        (64, 22),
    ),
    "finger": Reached(
        497_000,
        "return",
        {"oracle": EndPoint(246, 54), "autotune": EndPoint(207, 68), "dr": EndPoint(185, 23)},
        (59, 34),
    ),
    "rope_peg": Reached(
        384_000,
        "success",
        {"oracle": EndPoint(0.995), "autotune": EndPoint(0.42), "dr": EndPoint(0.15)},
        (61, 69),
    ),
    "cabinet_slide": Reached(
        436_000,
        "success",
        {"oracle": EndPoint(0.974), "autotune": EndPoint(0.75, 0.2), "dr": EndPoint(0.02)},
        None,
    ),
}
