"""The passage of an averaged motion through the separatrix: written once, for every form.

The separatrix divides the directions of G into four regions, about either end of axis a and of axis
c, which meet along four arcs. A torque that drives D alike in all of them takes the motion to the
other axis. Any other torque makes the region a matter of chance: a half turn beside the arc with
the signs (s1, s3) of p and r changes D by theta(s1, s3), into which a constant torque brings the
signs of p and r. Near D = 0 the motion takes one arc after the other, and which region keeps it
depends on D at its last turn, hence on the phase. Over all phases, evenly spread, each region has
its share.

Source: the probabilities of A. I. Neishtadt 1986 and of Cary, Escande and Tennyson 1986, here by
following the map.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import product
from typing import Any, NamedTuple

from ... import HodoError
from ...schema.kinds import Choice, Key
from .free_turn import Body
from .passage import CrossingPrediction, outcome, time_in_band

EDGE_U = 1e-10
"""The u at which a motion is taken through the separatrix by formula: their error is of the size of
its square, far below a double's last digit, and so much of u is left that 1 - m as a difference
costs them nothing."""

STOP, OTHER, REVERSED = "stop", "other-axis", "reversed"
"""The branches at the separatrix under a torque, as a case names them."""

AT_SEPARATRIX = Key(
    Choice(STOP, OTHER, REVERSED),
    "what becomes of a motion at the separatrix where the torque makes it a matter of chance",
    default=STOP,
)

Region = tuple[int, int]
"""The side, +1 (about axis a) or -1 (about axis c), and the sense, +1 or -1, of the rotation about
that axis."""

REGIONS: tuple[Region, ...] = ((1, 1), (1, -1), (-1, 1), (-1, -1))

Pair = tuple[Any, Any]
"""A quantity of the enclosed axis e, and that of the other axis o."""

UNKNOWN = CrossingPrediction(math.nan, 0, math.nan, math.nan, 0.0)
"""The prediction of a passage whose phase is not known."""

SAME_DRIFT = 1e-9
"""The difference, relative to the larger, up to which two drifts are equal."""

WEAKNESS = 0.5
"""How far off a probability may be, in units of half of what a half turn changes u by there: it is
that of the limit in which this is 0. Found against full motions was 0.36 at the most, 0.81 for
0.076 where the torque is as strong as the turns."""

MOST_HALF_TURNS = 100_000
"""Half turns that are followed, over all intervals of D: regions which neither take nor give keep
it for ever."""


class SeparatrixRates(NamedTuple):
    """The mean rates beside the separatrix in a region: (ln X_e)' = rest + by_e/K and (ln X_o)' =
    rest + by_o/K."""

    rest: float
    by_e: float
    by_o: float

    @property
    def drift(self) -> float:
        """u', times K."""
        return self.by_e - self.by_o

    @property
    def rate(self) -> float:
        """How fast amplitudes change between an axis and the separatrix: max|lambda| under linear
        resistance."""
        rates = self.drift, self.rest, self.rest + self.by_e, self.rest + self.by_o
        return max(map(abs, rates)) / 2

    def changes(self, time: float, u: float) -> tuple[float, float]:
        """The changes of ln X_e and ln X_o in a time in which u changes by `u`."""
        turns = u / self.drift  # the integral of dt/K
        return self.rest * time + self.by_e * turns, self.rest * time + self.by_o * turns


Bands = Mapping[Region, SeparatrixRates]


class Arrival(NamedTuple):
    """A motion at a small u before the separatrix: its region, ln X_e and ln X_o, and its phase;
    all but u in the working precision."""

    time: Any
    region: Region
    u: float
    logarithms: Pair
    phase: Any


class Departure(NamedTuple):
    """A motion behind the separatrix, in its new region, which goes on from the time `onward`;
    None: it stops there. `time` and `details` are stored."""

    time: float
    details: dict[str, float]
    region: Region
    logarithms: Pair
    phase: Any
    onward: Any = None


def pass_separatrix(
    body: Body,
    arrival: Arrival,
    bands_at: Callable[[Pair], Bands],
    branch: str,
    predictable: bool,
    beyond: float,
) -> Departure:
    """The passage, from a small u on one side to u = `beyond` on the other, by the formulas of
    `passage`.

    `bands_at` gives the rates at ln X_e and ln X_o of the arrival's side. A torque that drives D
    alike in all regions lets the motion change its axis; where that is `predictable` from its
    phase, its sense, place and lag are those predicted. Else the region is a matter of chance: the
    motion ends here or takes the `branch`. Regions have the sense about sorted axes, what is stored
    that about the axes as given: an odd order makes a left-handed system, in which every rotation
    is turned round.

    There the event that has found the separatrix cannot find it again. What is added to the
    state needs no more digits than a double has. Raises HodoError for a motion that comes back to
    the separatrix all the same, as a loose tolerance lets it.
    """
    side, _ = arrival.region
    bands = bands_at(arrival.logarithms)
    here = bands[arrival.region]
    pull = -here.drift
    if not pull > 0:
        raise HodoError(
            "the averaged motion comes back to the separatrix that it leaves: its tol is too large"
        )
    seconds = time_in_band(arrival.u, pull)
    edge = added(arrival.logarithms, here.changes(seconds, -arrival.u))
    amplitudes = tuple(math.exp(float(logarithm) / 2) for logarithm in edge)
    a, b, c = body[:3]
    n = math.sqrt((a - b if side > 0 else b - c) / (a * b * c)) * amplitudes[0]
    time = float(arrival.time) + seconds
    phase = arrival.phase + math.pi / 2 * n * arrival.u / pull
    details = {"momentum": momentum(body, amplitudes[::side]), "frequency": n}
    prediction, region = UNKNOWN, None
    if drives_alike(bands):
        foreseen = outcome(pull, n, float(phase), time, here.rate)
        prediction = foreseen if predictable else UNKNOWN._replace(scatter=foreseen.scatter)
        details |= prediction._asdict() | {"sense": float(body.parity * prediction.sense)}
        region = -side, prediction.sense or 1
    else:
        drift = drift_by_region(bands := bands_at(edge))
        shares = capture_shares(drift, arrival.region)
        details["probability"] = shares[-side, 1] + shares[-side, -1]
        details["probability_error"] = min(1.0, WEAKNESS * max(map(abs, drift.values())) / n)
        region = chosen_region(branch, shares, arrival.region)
    details["from"] = float(body.label(side))
    details["to"] = float(body.label(region[0])) if region else 0.0
    if region is None:
        return Departure(time, details, arrival.region, edge, phase)
    there = bands[region]
    onward = time_in_band(beyond, there.drift)
    # The lag is spent near the middle axis, at the rate there.
    changes = there.changes(onward + prediction.lag, beyond)
    place = prediction.place if math.isfinite(prediction.place) else 0.0
    return Departure(
        time,
        details,
        region,
        added(edge if region[0] == side else edge[::-1], changes),
        math.pi * (place + 0.5) + math.pi / 2 * n * beyond / there.drift,
        arrival.time + (seconds + prediction.lag + onward),
    )


def added(logarithms: Pair, changes: Pair) -> Pair:
    """The logarithms of X_e and X_o after changes of both."""
    return logarithms[0] + changes[0], logarithms[1] + changes[1]


def momentum(body: Body, amplitudes: Sequence[float]) -> float:
    """|G| of a motion with these sqrt(X) and sqrt(Y): G^2 = (a X + c Y)/(a - c)."""
    a, _, c = body[:3]
    x, y = amplitudes
    return math.hypot(math.sqrt(a) * x, math.sqrt(c) * y) / math.sqrt(a - c)


def drift_by_region(bands: Bands) -> dict[Region, float]:
    """The drift of D in the four regions, up to one factor."""
    return {region: region[0] * band.drift for region, band in bands.items()}


def drives_alike(bands: Bands) -> bool:
    """Whether D drifts by the same in both senses of rotation on either side."""
    about_a, turned_a, about_c, turned_c = (bands[region].drift for region in REGIONS)
    most = SAME_DRIFT * max(abs(about_a), abs(about_c))
    return abs(about_a - turned_a) <= most and abs(about_c - turned_c) <= most


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
    intervals, shares = [(low, low + turn, *arc)], dict.fromkeys(drift, 0.0)
    for _ in range(MOST_HALF_TURNS):
        if not intervals:
            break
        low, high, s1, s3 = intervals.pop()
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
                intervals.append((bottom, top, *onward))
    return shares


def chosen_region(branch: str, shares: Mapping[Region, float], start: Region) -> Region | None:
    """The region that a case's word means, or None if the motion is to stop or cannot go there."""
    side, sense = start
    onto = {OTHER: [(-side, 1), (-side, -1)], REVERSED: [(side, -sense)]}.get(branch, [])
    # Of two senses of rotation about the other axis, the one that keeps more phases.
    likely = max(onto, key=shares.__getitem__, default=start)
    return likely if likely != start and shares[likely] > 0 else None
