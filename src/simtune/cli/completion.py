"""Shell completion: tyro's scripts with improvements."""

import contextlib
import io
import re
from collections.abc import Iterator, Mapping, Sequence

from simtune.cli.help import first_sentence

_FOUND = "    completions = get_completions(words, current_index, COMPLETION_SPEC)"
# Only single quotes, since fish's script puts all of this between double quotes
_FILES_ELSE = """
    word = words[current_index] if current_index < len(words) else ''
    if not word.startswith('-') and all(its.startswith('-') for its in completions):
        completions = ['__TYRO_COMPLETE_FILES__']
"""
_MENDED = (
    # Bash adds a space to a folder's name unless told that these are files; and $cur starts with
    # the previous word, as if a colon joined both.
    (
        'COMPREPLY=($(compgen -f -- "$cur"))',
        "compopt -o filenames 2>/dev/null\n"
        "    local IFS=$'\\n'\n"
        '    COMPREPLY=($(compgen -f -- "${COMP_WORDS[COMP_CWORD]}"))',
    ),
    # Fish's words do not include the word being typed.
    (
        "    set -l current (count $words)",
        "    set -l current (count $words)\n    set -l typed (commandline -ct)",
    ),
    ("$words $current)", '$words "$typed" $current)'),
)


def asks_for_completion(typed: Sequence[str]) -> bool:
    return "--tyro-print-completion" in typed


@contextlib.contextmanager
def completion_mended(typed: Sequence[str], commands: Mapping[str, type]) -> Iterator[None]:
    """Improve a completion script printed within, if `typed` asks for one (tyro 1.0).

    Positional arguments, such as a tuning file, are completed as files. Commands are described by
    the first sentence of their docstring, and options in one line, since bash shows one line each.
    """
    if not asks_for_completion(typed):
        yield
        return
    stdout = io.StringIO()
    try:
        with contextlib.redirect_stdout(stdout):
            yield
    finally:
        print(_mended(stdout.getvalue(), commands), end="")


def _mended(script: str, commands: Mapping[str, type]) -> str:
    spec = re.compile(r"^COMPLETION_SPEC = .*$", re.MULTILINE)
    script = spec.sub(lambda match: _described(match[0].replace(r"\n", " "), commands), script)
    found = re.compile(rf"^{re.escape(_FOUND)}.*$", re.MULTILINE)
    script = found.sub(lambda match: match[0] + _FILES_ELSE, script)
    for old, new in _MENDED:
        script = script.replace(old, new)
    return script


def _described(spec: str, commands: Mapping[str, type]) -> str:
    """Replace tyro's description of each command, which is just its name."""
    for name, command in commands.items():
        text = first_sentence(command).rstrip(".")
        text = text.replace("'", "’").replace('"', "")  # safe within shell quotes
        spec = spec.replace(
            f"'{name}': {{'description': '{name}'", f"'{name}': {{'description': '{text}'"
        )
    return spec
