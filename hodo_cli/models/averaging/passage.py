"""The passage of an averaged motion through the separatrix: written once, for every form.

The separatrix divides the directions of G into four regions, about either end of axis a and of axis
c, which meet along four arcs. A torque that drives D alike in all of them takes the motion to the
other axis. Any other torque makes the region a matter of chance: a half turn beside the arc with
the signs (s1, s3) of p and r changes D by theta(s1, s3), into which a constant torque brings the
signs of p and r. Near D = 0 the motion takes one arc after the other, and which region keeps it
depends on D at its last turn, hence on the phase. Over all phases, evenly spread, each region has
its share.

Where D is driven alike in all regions, the true motion crosses in one of the half turns about the
time t* at which the averaged one does. With u' = -speed/K near u = 0 (under linear resistance the
speed is 2 |l1 - l3|), each half turn lowers u by 2 speed/n. With s in (0, 1) the place where D = 0
falls in that sequence,

    n (t - t*) = F(s) + O(epsilon)
    F(s) = (1/2 - s) ln(8 n/speed) + ln Gamma(s) - ln(2 pi)/2 + ln(s/(1 - s))/2

whose mean over s is 0 (Raabe). s follows from the phase at t*, if the motion starts from mean
elements: s = frac(phi/pi - 1/2), and the number of the half turn says in which sense it rotates
afterwards. Reversed in time, the same holds with 1 - s: so afterwards the motion lags behind by
F(s) + F(1 - s) = -ln(2 sin pi s), over n, and its phase goes on from pi(s + 1/2), up to half turns.
It lingers near the middle axis meanwhile, where linear resistance takes it down by exp(-l2 lag).

Source: the probabilities of A. I. Neishtadt 1986 and of Cary, Escande and Tennyson 1986, here by
following the map; the time derived here by summing the half turns with Stirling's formula, and
checked against full motions; of the kind of A. I. Neishtadt 1986 and J. R. Cary and R. T. Skodje,
Physica D 36 (1989) 287, for Hamiltonian systems.
"""

import math
from collections.abc import Callable, Mapping
from itertools import product
from typing import Any, NamedTuple

from ... import HodoError
from ...schema.kinds import Choice, Key
from ..base import EventOutcome
from .free_turn import Body, either, turning_body

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

SAME_DRIFT = 1e-9
"""The difference, relative to the larger, up to which two drifts are equal."""

PROBABILITY_ERROR = 0.5
"""How far off a probability may be, in units of half of what a half turn changes u by there: it is
that of the limit in which this is 0. Found against full motions was 0.36 at the most, 0.81 for
0.076 where the torque is as strong as the turns."""

MOST_HALF_TURNS = 100_000
"""Half turns that are followed, over all intervals of D: regions which neither take nor give keep
it for ever."""


class SeparatrixRates(NamedTuple):
    """The mean rates beside the separatrix in a region: (ln X_e)' = limit + by_e/K and (ln X_o)' =
    limit + by_o/K."""

    limit: float
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
        rates = self.drift, self.limit, self.limit + self.by_e, self.limit + self.by_o
        return max(map(abs, rates)) / 2

    def moved(self, logarithms: Pair, time: float, u: float) -> Pair:
        """ln X_e and ln X_o after a time in which u changes by `u`."""
        turns = u / self.drift  # the integral of dt/K
        ln_e, ln_o = logarithms
        # What is added needs no more digits than a double has.
        return (
            ln_e + (self.limit * time + self.by_e * turns),
            ln_o + (self.limit * time + self.by_o * turns),
        )


RatesByRegion = Mapping[Region, SeparatrixRates]


class CrossingPrediction(NamedTuple):
    """The prediction of the true motion at its passage; times as that of the passage. Without
    arguments that of a passage whose phase is not known.

    `place` is s; `sense` that of the rotation about the new axis, 0 where it is undetermined, and
    then `predicted` is nan; `scatter` the rms over all phases of predicted - t*; `lag` that of the
    motion afterwards.
    """

    place: float = math.nan
    sense: int = 0
    predicted: float = math.nan
    scatter: float = math.nan
    lag: float = 0.0


def foreseen_crossing(
    speed: float, n: float, phase: float, time: float, rate: float
) -> CrossingPrediction:
    """The prediction of a passage at `time` t* with frequency n and phase there.

    The ratio of the perturbation's `rate` to n is the parameter of averaging. Where that is not
    below 1 there is nothing to foresee: nan, and no lag.
    """
    if not rate < n:  # the motion stops before it has turned: the half turns are not there
        return CrossingPrediction()
    place = (phase / math.pi - 0.5) % 1.0
    reach = math.log(8 * n / speed)
    scatter = reach / math.sqrt(12) / n
    if not place:  # to the last digit between two half turns: nothing decides
        return CrossingPrediction(place, scatter=scatter)
    shift = (0.5 - place) * reach + math.lgamma(place) - math.log(2 * math.pi) / 2
    shift += math.log(place / (1 - place)) / 2
    half_turns = round(phase / math.pi - place + 0.5)
    # The measured error of s is a fifth of rate/n. Nearer to 0 or 1 than that, the motion may
    # cross a half turn sooner or later; the lag, which is even about s = 1/2, hardly changes.
    is_sure = min(place, 1 - place) > rate / n
    sense, predicted = ((-1) ** half_turns, time + shift / n) if is_sure else (0, math.nan)
    lag = -math.log(2 * math.sin(math.pi * place)) / n
    return CrossingPrediction(place, sense, predicted, scatter, lag)


def time_to_separatrix(u: float, speed: float) -> float:
    """The time from u to the separatrix where u' = -speed/K, K = ln(16/u)/2: right to O(u^2)."""
    return u * (math.log(16 / u) + 1) / (2 * speed)


class Arrival(NamedTuple):
    """A motion at a small u before the separatrix: its region, ln X_e and ln X_o, and its phase;
    all but u in the working precision."""

    time: Any
    region: Region
    u: float
    logarithms: Pair
    phase: Any


def pass_separatrix(
    k: Any, arrival: Arrival, rates_at: Callable[[Pair], RatesByRegion], predictable: bool
) -> EventOutcome:
    """The passage, from a small u on one side to u = 2 turning_edge on the other, by the formulas
    above; its state is ln X_e and ln X_o, the phase, the side and the sense. The constants are
    doubles.

    `rates_at` gives the rates at sqrt(X) and sqrt(Y). A torque that drives D alike in all regions
    takes the motion to the other axis; its sense, place and lag are predicted where its phase makes
    them `predictable`. Under any other torque the region is a matter of chance: the motion ends
    here or takes the branch of its case.

    Raises HodoError for a motion that comes back to the separatrix all the same, as a loose
    tolerance lets it.
    """
    body, side = turning_body(k), arrival.region[0]
    rates = rates_at(sorted_roots(arrival.logarithms, side))
    here = rates[arrival.region]
    speed = -here.drift
    if not speed > 0:
        raise HodoError(
            "the averaged motion comes back to the separatrix that it leaves: its tol is too large"
        )
    seconds = time_to_separatrix(arrival.u, speed)
    time = float(arrival.time) + seconds
    logarithms = here.moved(arrival.logarithms, seconds, -arrival.u)
    roots = sorted_roots(logarithms, side)
    n = either(side, *k.turning_n) * roots[::side][0]
    phase = arrival.phase + math.pi / 2 * n * arrival.u / speed
    details, prediction = {"momentum": momentum(body, roots), "frequency": n}, CrossingPrediction()
    region: Region | None
    if drives_alike(rates):
        foreseen = foreseen_crossing(speed, n, float(phase), time, here.rate)
        prediction = foreseen if predictable else CrossingPrediction(scatter=foreseen.scatter)
        region = -side, prediction.sense or 1
        # Regions have the sense about the sorted axes, a result that about the axes as given: an
        # odd order makes a left-handed system, in which every rotation is turned round.
        details |= prediction._asdict() | {"sense": float(body.parity * prediction.sense)}
    else:
        rates = rates_at(roots)
        region, chances = region_by_chance(rates, arrival.region, n, k.turning_branch)
        details |= chances
    details["from"] = float(body.label(side))
    details["to"] = float(body.label(region[0])) if region else 0.0
    if region is None:
        return EventOutcome(time, details, (*logarithms, phase, *arrival.region))
    # Axes e and o change places with the side.
    logarithms = logarithms[:: side * region[0]]
    # Behind the edge the event that has found the separatrix cannot find it again.
    onward, *state = departure(rates[region], logarithms, n, prediction, 2 * k.turning_edge)
    resumed = arrival.time + (seconds + prediction.lag + onward)
    # The samples in the lag are on the way, too.
    lingering = rates[region].limit, rates[region].limit, 0.0, 0.0, 0.0
    return EventOutcome(time, details, (*state, *region), resumed, lingering)


def departure(
    there: SeparatrixRates, logarithms: Pair, n: float, prediction: CrossingPrediction, u: float
) -> tuple[float, Any, Any, float]:
    """The time from the separatrix to `u` in a region with these rates, without the lag, and there
    ln X_e, ln X_o and the phase; the logarithms are those at the separatrix."""
    onward = time_to_separatrix(u, there.drift)
    # The lag is spent near the middle axis, at the rate there.
    ln_e, ln_o = there.moved(logarithms, onward + prediction.lag, u)
    place = prediction.place if math.isfinite(prediction.place) else 0.0
    phase = math.pi * (place + 0.5) + math.pi / 2 * n * u / there.drift
    return onward, ln_e, ln_o, phase


def sorted_roots(logarithms: Pair, side: int) -> Pair:
    """sqrt(X) and sqrt(Y) from ln X_e and ln X_o."""
    root_x, root_y = (math.exp(float(ln) / 2) for ln in logarithms[::side])
    return root_x, root_y


def momentum(body: Body, roots: Pair) -> float:
    """|G| of a motion with these sqrt(X) and sqrt(Y): G^2 = (a X + c Y)/(a - c)."""
    a, _, c = body[:3]
    x, y = roots
    return math.hypot(math.sqrt(a) * x, math.sqrt(c) * y) / math.sqrt(a - c)


def drift_by_region(rates: RatesByRegion) -> dict[Region, float]:
    """The drift of D in the four regions, up to one factor."""
    return {region: region[0] * beside.drift for region, beside in rates.items()}


def drives_alike(rates: RatesByRegion) -> bool:
    """Whether D drifts by the same in both senses of rotation on either side."""
    about_a, turned_a, about_c, turned_c = (rates[region].drift for region in REGIONS)
    rounding = SAME_DRIFT * max(abs(about_a), abs(about_c))
    return abs(about_a - turned_a) <= rounding and abs(about_c - turned_c) <= rounding


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
    change = arc_changes(drift)
    side, sense = start
    # Farther than two half turns can carry it, D keeps its sign until the drift of its region
    # brings it back.
    beyond = 2 * max(map(abs, change.values()))
    # All phases of a motion that comes in: an interval as wide as one turn shifts D.
    turn = 2 * abs(drift[start])
    low = beyond if side > 0 else -beyond - turn
    intervals = [(low, low + turn, (sense, 1) if side > 0 else (1, sense))]
    shares = dict.fromkeys(drift, 0.0)
    for _ in range(MOST_HALF_TURNS):
        if not intervals:
            break
        low, high, (s1, s3) = intervals.pop()
        low, high = low + change[s1, s3], high + change[s1, s3]
        # Above 0 the next arc lies about the same end of axis a, below about the same end of c.
        above = max(low, 0.0), high, (1, s1), (s1, -s3)
        below = low, min(high, 0.0), (-1, s3), (-s1, s3)
        for bottom, top, region, next_arc in (above, below):
            if not top > bottom:
                continue
            is_far = bottom > beyond if region[0] > 0 else top < -beyond
            if is_far and drift[region] * region[0] > 0:
                shares[region] += (top - bottom) / turn
            else:
                intervals.append((bottom, top, next_arc))
    return shares


def region_by_chance(
    rates: RatesByRegion, start: Region, n: float, branch: str
) -> tuple[Region | None, dict[str, float]]:
    """The region that a motion out of the region `start` enters on the branch of its case, None
    where it stops or cannot go there; and the probability that it goes to the other axis, with its
    error, by their names as details of the event."""
    shares, (side, sense) = capture_shares(drift_by_region(rates), start), start
    others = [(-side, 1), (-side, -1)]
    onto = {OTHER: others, REVERSED: [(side, -sense)]}.get(branch, [])
    # Of two senses of rotation about the other axis, the one that keeps more phases.
    likely = max(onto, key=shares.__getitem__, default=start)
    region = likely if likely != start and shares[likely] > 0 else None
    error = PROBABILITY_ERROR * max(abs(beside.drift) for beside in rates.values()) / n
    probability = sum(shares[other] for other in others)
    return region, {"probability": probability, "probability_error": min(1.0, error)}
