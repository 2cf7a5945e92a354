"""An update of a network, or acting by it, as a CUDA graph: one launch in place of hundreds."""

from collections.abc import Callable

import torch

Step = Callable[..., torch.Tensor]  # tensors in, a tensor of losses or actions out

_WARM_UP_CALLS = 3  # before the capture: in them, libraries allocate and choose kernels
CALLS_BEFORE_REPLAY = _WARM_UP_CALLS + 1


def graphed(step: Step, generator: torch.Generator) -> Step:
    """The step as a graph if its random numbers are of a GPU; else the step itself."""
    return GraphedStep(step, generator) if generator.device.type == "cuda" else step


def make_capturable(optimizer: torch.optim.Optimizer, device: torch.device) -> None:
    """On a GPU, keep an optimiser's learning rates there, so that its steps can be captured."""
    if device.type == "cuda":
        for group in optimizer.param_groups:
            group["capturable"] = True
            group["lr"] = torch.as_tensor(group["lr"], device=device)


def set_rate(optimizer: torch.optim.Optimizer, rate: float) -> None:
    """The learning rate of the next steps, graphs or not."""
    for group in optimizer.param_groups:
        if isinstance(group["lr"], torch.Tensor):
            group["lr"].fill_(rate)
        else:
            group["lr"] = rate


class GraphedStep:
    """Calls `step` directly at first, then captures it and replays the capture.

    Every call is a real update, also during warm-up. Conditions for a graph: inputs are copied into
    buffers of its own, so their shapes must stay; nothing in `step` waits for the host; random
    numbers come from `generator`; optimisers are `capturable`. Memory that `step` reads and writes
    (weights, moments) must stay in place: after a checkpoint is loaded, make a new one.
    """

    def __init__(self, step: Step, generator: torch.Generator):
        self._step, self._generator = step, generator
        self._graph: torch.cuda.CUDAGraph | None = None
        self._inputs: list[torch.Tensor] = []
        self._output = torch.empty(0)
        self._calls = 0

    def __call__(self, *inputs: torch.Tensor) -> torch.Tensor:
        """The output of `step`, in memory that the next call may overwrite."""
        self._calls += 1
        with torch.cuda.device(self._generator.device):  # streams belong to the current device
            if self._calls <= _WARM_UP_CALLS:
                return self._warm_up(*inputs)
            graph = self._graph = self._graph or self._capture(*inputs)
            for buffer, value in zip(self._inputs, inputs, strict=True):
                buffer.copy_(value)
            graph.replay()
        return self._output

    def _warm_up(self, *inputs: torch.Tensor) -> torch.Tensor:
        """On a side stream, like a capture."""
        side, usual = torch.cuda.Stream(), torch.cuda.current_stream()
        side.wait_stream(usual)
        with torch.cuda.stream(side):
            output = self._step(*inputs)
        usual.wait_stream(side)
        return output

    def _capture(self, *inputs: torch.Tensor) -> torch.cuda.CUDAGraph:
        """Record the step without running it."""
        self._inputs = [value.clone(memory_format=torch.contiguous_format) for value in inputs]
        graph = torch.cuda.CUDAGraph()
        graph.register_generator_state(self._generator)  # newer versions of torch do so themselves
        with torch.cuda.graph(graph):
            self._output = self._step(*self._inputs)
        return graph
