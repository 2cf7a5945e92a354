"""What a film's comparison with a simulator's pictures means, a sentence each."""

from simtune.checking.film.camera_film import CameraFilm
from simtune.checking.film.compare import Comparison
from simtune.checking.film.explanations import AtOdds
from simtune.checking.film.turned import Turned

_MIN_SIMILARITY = 0.6  # relative to that among the simulator's worlds
_STILL_SHARE = 0.05  # of the motion in the other one, film or simulator
_MIN_MOVING_SHARE = 1e-3  # of pixels: with fewer, nothing moves in a film
_STUCK = (
    "things move in the film, and nothing moves in the simulator as it plays the recorded actions: "
    "the model is stuck, and no motion can be compared; does an actuator reach the joint, is it "
    "locked or held by its limits, or is something in the way?"
)
_EXCHANGED = (
    "what moves in the film moves as camera {} sees it, and what moves in that one's film as this "
    "camera does: are their keys exchanged?"
)
_ROOM = '; where the room around, or a shadow, is not in the model, say background = "{}"'
_OR_A_SHADOW = "; or something else moves, such as a shadow"  # what stands still is the film's


def warnings_of_film(
    film: CameraFilm,
    comparison: Comparison,
    exchanged_with: str | None = None,
    turned: Turned | None = None,
    at_odds: AtOdds | None = None,
    *,
    camera_moves: bool = False,
) -> list[str]:
    """A sentence if the film cannot show the simulator's scene as its camera sees it.

    `exchanged_with`: the camera whose film this one seems to have instead. `turned`: how it is
    turned, beside readings. `at_odds`: what explains it beside actions.
    """
    if exchanged_with is not None:
        return [_EXCHANGED.format(exchanged_with)]
    if turned is not None:
        return [_against_readings(turned)]
    if at_odds is not None:
        return [_against_actions(at_odds)]
    found = _beside_simulated(film, comparison, camera_moves)
    if found and camera_moves and not film.view.background_is_unknown:
        found += _ROOM.format("unknown")
    return [found] if found else []


def _beside_simulated(film: CameraFilm, comparison: Comparison, camera_moves: bool) -> str:
    """What is unlike the simulator's pictures; empty if nothing is."""
    if (
        comparison.simulated_moving_share
        < _STILL_SHARE * comparison.moving_share
        > _STILL_SHARE * _MIN_MOVING_SHARE
    ):
        return _STUCK
    if comparison.moving_share < _STILL_SHARE * comparison.simulated_moving_share:
        return "nothing moves in the film, though the simulator's parts do: is it this scene?"
    if film.view.background_is_unknown:  # the film shows more than the simulator draws
        return ""
    other = "and even then another scene than the simulator's, or seen from elsewhere"
    if comparison.is_reframed:
        also = f", {other}" * (comparison.framed_alike < _MIN_SIMILARITY)
        return f"beside the simulator's pictures the film looks {comparison.framing.says}{also}"
    if comparison.alike >= _MIN_SIMILARITY:
        return ""
    why = "" if camera_moves else _OR_A_SHADOW if film.is_plate else _ROOM.format("recording")
    return (
        "the film looks like another scene than the simulator's, or seen from elsewhere: "
        f"{comparison.alike:.2f} times as like it as the simulator's own worlds are to each "
        f"other{why}"
    )


def _against_readings(turned: Turned) -> str:
    mirrored = {framing.is_mirrored for framing in turned.framings}
    mend = "mirror the film back" if all(mirrored) else "turn the film back, or the camera"
    if len(mirrored) > 1:
        mend = "turn or mirror the film back"
    if joints := " and ".join(turned.reversed):
        mend += f", or reverse the sign of {joints} in the sensor (and in [actions], if both agree)"
    if any(framing.is_mirrored and framing.is_on_its_side for framing in turned.framings):
        mend += "; or are columns of readings exchanged?"
    if turned.elsewhere:
        mend += f"; or is the zero of {turned.elsewhere} elsewhere?"
    return f"the film is {turned.says}, against what readings say: {mend}"


def _against_actions(odds: AtOdds) -> str:
    if odds.actions_of:
        pairs = [f"in {episode} it follows {other}'s" for episode, other in odds.actions_of.items()]
        return (
            "what moves does not follow its own episode's actions: "
            f"{', '.join(pairs)}; are files exchanged?"
        )
    signs = " or of ".join(odds.reversed)
    if not odds.framings:
        return (
            f"what moves in the film moves as if the sign of {signs} were reversed: reverse it "
            '(mapping = "scaled" with a negative gain in [actions]), or the joint\'s axis'
        )
    looks = " or ".join(dict.fromkeys(framing.says for framing in odds.framings))
    or_signs = f", or the sign of {signs} is reversed" * bool(signs)
    return (
        f"the film looks {looks} beside simulated worlds that play its actions{or_signs}; as it "
        "is, what moves does not move when the simulator's does"
    )


def all_clear(film: CameraFilm, comparison: Comparison) -> str:
    """What no warning means: only what was compared can have differed."""
    if not film.is_plate:
        return "nothing says that this is another scene or another view"
    own = "the background is the film's own"
    if covering := [f"{n} paints ({share:.0%})" for n, share in film.painted.items() if share]:
        own += f" but for what {' and '.join(covering)}"
    return (
        f"{own}, so it tells nothing: only what moves was compared, not its colours. Its likeness: "
        f"{comparison.alike:.2f} (1: as between simulated worlds of other parameters; the less, "
        "the less like)"
    )
