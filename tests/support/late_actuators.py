"""The delay of actuators as a parameter."""

from simtune.parameters import Parameter


def delay(name: str, actuators: tuple[str, ...], high_s: float) -> Parameter:
    """Of the actuators behind their controls: 0 to `high_s` seconds, nominally 0.

    A delay between 0 and one physics step acts as one step.
    """
    return Parameter(
        name=name,
        field="actuator_delay",
        objects=actuators,
        nominal=0.0,
        low=0.0,
        high=high_s,
        scale="linear",
        unit="s",
    )
