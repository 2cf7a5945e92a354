"""Values of TOML files: of which kind they are, and how messages show them."""

import math
from typing import Any

from simtune.validate import is_number

MOST = 2**63  # from here on whole numbers do not fit into 64 bits


def for_numpy(value: Any) -> Any:
    """With floats in place of whole numbers beyond 64 bits, of which numpy makes objects."""
    if isinstance(value, list):
        return [for_numpy(item) for item in value]
    is_huge = isinstance(value, int) and abs(value) >= MOST
    return float(value) if is_huge else value


def are_numbers(value: Any, count: int) -> bool:
    return isinstance(value, list) and len(value) == count and all(map(is_number, value))


def is_pair(value: Any) -> bool:
    return are_numbers(value, 2) and value[0] <= value[1]


def are_names(value: Any) -> bool:
    names = [value] if isinstance(value, str) else value
    return isinstance(names, list) and bool(names) and all(n and isinstance(n, str) for n in names)


def are_tables(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(v, dict) for v in value)


def is_array(value: Any) -> bool:
    if isinstance(value, list):
        return bool(value) and all(map(is_array, value))
    return is_number(value) or value in (math.inf, -math.inf)


def shown(value: Any) -> str:
    """A value for messages, approximately in TOML's notation, at most 60 characters."""
    if isinstance(value, bool):
        return str(value).lower()
    said = "a table" if isinstance(value, dict) else repr(value)
    return said if len(said) <= 60 else f"{said[:57]}..."
