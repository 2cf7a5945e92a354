"""A machine whose work takes what a test says, by a clock of its own: slow without waiting."""

import time
from dataclasses import dataclass

from simtune.networks.training import TrainingClock
from simtune.search_param_model import posterior
from simtune.simulation import Simulator


@dataclass
class SlowMachine:
    """Its clock goes on only by the work that is done."""

    step_s: float  # a world's policy step
    frame_s: float  # a picture drawn
    detect_s: float  # a picture detected
    update_s: float  # an update of any network
    now_s: float = 0.0

    def slower(self, factor: float) -> "SlowMachine":
        times = (self.step_s, self.frame_s, self.detect_s, self.update_s)
        return SlowMachine(*(factor * t for t in times))

    def take_over(self, monkeypatch) -> None:
        """Everything is timed by this machine from now on."""
        play, render, detect = Simulator.play, Simulator.render, posterior.detect
        step, model = TrainingClock.step, posterior.PosteriorSearchParamModel
        time_updates = model.time_updates

        def slow_play(simulator, parameters, act, num_steps, *rest, **options):
            self.now_s += self.step_s * len(parameters) * num_steps
            return play(simulator, parameters, act, num_steps, *rest, **options)

        def slow_render(simulator, states, parameters, stray=None):
            self.now_s += self.frame_s * len(states)
            return render(simulator, states, parameters, stray)

        def slow_detect(detector, frames):
            self.now_s += self.detect_s * len(frames)
            return detect(detector, frames)

        def slow_step(clock):
            self.now_s += self.update_s
            step(clock)

        def slow_updates(model, frames, num):
            self.now_s += self.update_s * num
            time_updates(model, frames, num)

        monkeypatch.setattr(time, "monotonic", lambda: self.now_s)
        monkeypatch.setattr(Simulator, "play", slow_play)
        monkeypatch.setattr(Simulator, "render", slow_render)
        monkeypatch.setattr(posterior, "detect", slow_detect)
        monkeypatch.setattr(TrainingClock, "step", slow_step)
        monkeypatch.setattr(model, "time_updates", slow_updates)
