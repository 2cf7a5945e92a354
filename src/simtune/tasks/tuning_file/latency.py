"""How late a camera or a sensor is, in a tuning file."""

from simtune.tasks.tuning_file.toml_table import TomlTable

_LONGEST_S = 1.0


def read_latency_s(table: TomlTable) -> float:
    """Its `latency_s`, 0 by default. Raises InputError."""
    latency_s = table.number("latency_s", 0.0)
    if not 0 <= latency_s <= _LONGEST_S:
        bounds = f"lie in [0, {_LONGEST_S:g}] s"
        raise table.error(f"latency_s must {bounds}, got {latency_s:g}", "latency_s")
    return latency_s
