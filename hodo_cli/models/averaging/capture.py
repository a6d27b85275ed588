"""Where a motion ends up that comes to the separatrix under torques that tell its regions apart.

The separatrix divides the directions of G into four regions, about either end of axis a and of axis
c, which meet along four arcs. A half turn beside the arc with the signs (s1, s3) of p and r changes
D by theta(s1, s3): a constant torque brings the signs of p and r in, a resistance does not. Near D
= 0 the motion takes one arc after the other, and which region keeps it hangs on D at its last turn:
on the phase. Over all phases, evenly spread, it is a matter of shares.

Source: the probabilities of A. I. Neishtadt 1986 and of Cary, Escande and Tennyson 1986, here by
following the map.
"""

from collections.abc import Mapping
from itertools import product

from ...schema.kinds import Choice, Key

FREE, STOP, OTHER, REVERSED = "free", "stop", "other-axis", "reversed"
"""What happens at the separatrix: without a torque the motion goes through, else as the case
says."""

AT_SEPARATRIX = Key(
    Choice(STOP, OTHER, REVERSED),
    "what becomes of a motion at the separatrix where the torque makes it a matter of chance",
    default=STOP,
)

Region = tuple[int, int]
"""A side (+1: axis a, -1: axis c) and the sense of rotation about that axis."""

MOST_HALF_TURNS = 100_000
"""Half turns that are followed, over all intervals of D: regions which neither take nor give keep
it for ever."""


def arc_changes(drift: Mapping[Region, float]) -> dict[tuple[int, int], float]:
    """theta(s1, s3) from the mean drift of D near the separatrix in each region, in any one
    unit."""
    about_a = (drift[1, 1] - drift[1, -1]) / 2
    about_c = (drift[-1, 1] - drift[-1, -1]) / 2
    common = (drift[1, 1] + drift[1, -1]) / 2
    return {(s1, s3): s1 * about_a + s3 * about_c + common for s1, s3 in product((1, -1), repeat=2)}


def capture_shares(drift: Mapping[Region, float], start: Region) -> dict[Region, float]:
    """The share of phases that each region keeps of the motions that come out of the region
    `start`.

    Followed are not motions but intervals of D, which a half turn shifts and the separatrix cuts in
    two, so the shares are exact. Phases whose end is not found in MOST_HALF_TURNS are in none of
    them.
    """
    theta = arc_changes(drift)
    side, sense = start
    # Farther than two half turns can carry it, D keeps its sign until the drift of its region
    # brings it back.
    beyond = 2 * max(map(abs, theta.values()))
    # All phases of a motion that comes in: an interval as wide as one turn shifts D.
    turn = 2 * abs(drift[start])
    low = beyond if side > 0 else -beyond - turn
    arc = (sense, 1) if side > 0 else (1, sense)
    parts, shares = [(low, low + turn, *arc)], dict.fromkeys(drift, 0.0)
    for _ in range(MOST_HALF_TURNS):
        if not parts:
            break
        low, high, s1, s3 = parts.pop()
        low, high = low + theta[s1, s3], high + theta[s1, s3]
        # Above 0 the next arc lies about the same end of axis a, below about the same end of c.
        for bottom, top, region, onward in (
            (max(low, 0.0), high, (1, s1), (s1, -s3)),
            (low, min(high, 0.0), (-1, s3), (-s1, s3)),
        ):
            if not top > bottom:
                continue
            away = bottom > beyond if region[0] > 0 else top < -beyond
            if away and drift[region] * region[0] > 0:
                shares[region] += (top - bottom) / turn
            else:
                parts.append((bottom, top, *onward))
    return shares


def branch(name: str, shares: dict[Region, float], start: Region) -> Region | None:
    """The region that a case's word means, or None if the motion is to stop or cannot go there."""
    side, sense = start
    onto = {OTHER: [(-side, 1), (-side, -1)], REVERSED: [(side, -sense)]}.get(name, [])
    # Of two senses of rotation about the other axis, the one that keeps more phases.
    likely = max(onto, key=shares.__getitem__, default=start)
    return likely if likely != start and shares[likely] > 0 else None
