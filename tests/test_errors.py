"""Messages about names that do not exist."""

import pytest

from simtune.errors import UnknownName

FIELDS = [f"field_{number}" for number in range(100)]


@pytest.mark.parametrize(
    ("name", "known", "said"),
    [
        ("lenght", ["mass", "length"], "; did you mean 'length'?"),
        ("palm", ["robot0:wrist", "robot0:palm"], "; did you mean 'robot0:palm'?"),
        ("leg", ["arm", "a_leg", "b_leg"], "; did you mean 'a_leg'? there are: a_leg, b_leg"),
        ("weight", ["mass", "light"], "; did you mean 'light'? there are: mass, light"),
        ("xyz", ["mass", "light"], "; there are: mass, light"),
        ("", ["mass", "light"], "; there are: mass, light"),
        ("xyz", FIELDS, f"; there are: {', '.join(FIELDS[:60])} and 40 more"),
        ("mass", [], ", which has none"),
    ],
)
def test_an_unknown_name_is_told_with_what_may_be_meant(name, known, said):
    """Others as well, unless one is surely meant."""
    whole = str(UnknownName("kind", name, "tune.toml", known))
    assert whole == f"no kind {name!r} in tune.toml{said}"
