"""What is checked of numbers alike for every command."""

from simtune.errors import InputError


def at_least(config: object, smallest: int, *names: str) -> None:
    """Raises InputError where one of these fields is less; None is left to its default."""
    for name in names:
        value = getattr(config, name)
        if value is not None and value < smallest:
            bound = f"be at least {smallest}" if smallest else "not be negative"
            raise InputError(f"{flag(name)} must {bound}, got {value}")


def flag(name: str) -> str:
    """A field as it is asked for on the command line."""
    return f"--{name.replace('_', '-')}"
