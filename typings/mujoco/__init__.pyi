# MuJoCo's wheel has no stubs, and its extension module hides all names from a type checker.
from typing import Any

def __getattr__(name: str) -> Any: ...
