"""The built-in tasks, by name."""

from collections.abc import Callable

from simtune.tasks import ball_in_cup, cabinet_slide, cartpole, cheetah, finger, rope_peg, walker
from simtune.tasks.task import Task

TASKS: dict[str, Callable[[], Task]] = {
    "ball_in_cup": ball_in_cup.catch,
    "walker": walker.walk,
    "cheetah": cheetah.run,
    "finger": finger.spin,
    "rope_peg": rope_peg.insert,
    "cabinet_slide": cabinet_slide.slide,
    "cartpole": cartpole.balance,
}
