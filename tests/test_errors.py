"""Messages about names that do not exist."""

import pytest

from simtune.errors import UnknownName


@pytest.mark.parametrize(
    ("name", "known", "said"),
    [
        ("lenght", ["mass", "length"], "; did you mean 'length'?"),
        ("palm", ["robot0:wrist", "robot0:palm"], "; did you mean 'robot0:palm'?"),
        ("weight", ["mass", "light"], "; did you mean 'light'? there are: mass, light"),
        ("xyz", ["mass", "light"], "; there are: mass, light"),
        ("mass", [], ", which has none"),
    ],
)
def test_an_unknown_name_is_told_with_what_may_be_meant(name, known, said):
    """All there are, unless one is surely meant."""
    assert (
        str(UnknownName("kind", name, "tune.toml", known)) == f"no kind {name!r} in tune.toml{said}"
    )
