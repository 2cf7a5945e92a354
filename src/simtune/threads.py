"""How threads of libraries wait for each other."""

import os


def wait_passively() -> None:
    """Let threads sleep while they wait, unless the environment says otherwise.

    To be called before torch is loaded, which reads it then. Threads that spin make training five
    times slower as soon as anything else runs on the machine.
    """
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
