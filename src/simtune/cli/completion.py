"""Shell completion: tyro's scripts, and what they lack."""

import contextlib
import io
import re
from collections.abc import Iterator, Mapping, Sequence

_FOUND = "    completions = get_completions(words, current_index, COMPLETION_SPEC)"
# Single quotes, since fish has all of this between double ones.
_FILES_ELSE = """
    word = words[current_index] if current_index < len(words) else ''
    if not word.startswith('-') and all(its.startswith('-') for its in completions):
        completions = ['__TYRO_COMPLETE_FILES__']
"""
_MENDED = (
    # Bash adds a space to a folder's name, unless it is told that these are files; and $cur begins
    # with the word before, as if both had a colon between them.
    (
        'COMPREPLY=($(compgen -f -- "$cur"))',
        "compopt -o filenames 2>/dev/null\n"
        "    local IFS=$'\\n'\n"
        '    COMPREPLY=($(compgen -f -- "${COMP_WORDS[COMP_CWORD]}"))',
    ),
    # Fish's words end before the one that is being typed.
    (
        "    set -l current (count $words)",
        "    set -l current (count $words)\n    set -l typed (commandline -ct)",
    ),
    ("$words $current)", '$words "$typed" $current)'),
)


@contextlib.contextmanager
def completion_mended(typed: Sequence[str], commands: Mapping[str, type]) -> Iterator[None]:
    """What is printed meanwhile, if `typed` asks for a shell's completion script (tyro 1.0).

    Arguments without an option, such as a tuning file, are completed as files, and commands are
    described by the first sentence of what they say of themselves. Bash shows a line for each
    option, so what is said of it gets no more than one.
    """
    if "--tyro-print-completion" not in typed:
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
    """Of each command tyro says no more than its name."""
    for name, command in commands.items():
        sentence = " ".join(str(command.__doc__).split()).partition(". ")[0]
        said = sentence.rstrip(".").replace("'", "’").replace('"', "")  # within any shell's quotes
        spec = spec.replace(
            f"'{name}': {{'description': '{name}'", f"'{name}': {{'description': '{said}'"
        )
    return spec
