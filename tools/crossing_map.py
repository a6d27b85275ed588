"""Crossing times of all starts by averaging, beside a sweep of full motions: cost and difference.

    python tools/crossing_map.py runs/sweep_crossing.h5

The file is that of a sweep of linear-diag over directions of G with |G| = 1 and one more axis, with
crossing_time stored. Averaged, one table of t*(u) serves all starts of one damping.
"""

import sys
from time import perf_counter

import numpy as np

from hodo_cli.figures.costs import damping_of
from hodo_cli.models.averaging.free_turn import Body
from hodo_cli.models.averaging.passage import crossing_table
from hodo_cli.results.dataset import open_results
from hodo_cli.sweeps.swept import Swept


def tabulated_times(lam: list[float], side: np.ndarray, u: np.ndarray) -> np.ndarray:
    """t* (n,) of starts at u (n,) on their sides (n,); nan where they never cross."""
    crossing = 1 if lam[0] > lam[2] else -1
    places, times = crossing_table(lam, crossing)
    if not len(places):
        return np.full(len(u), np.nan)
    return np.where(side == crossing, np.interp(u, places, times, right=np.nan), np.nan)


def shapes(body: Body, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Side (n,) and u (n,) of starts with G along directions (n, 3) in the body axes."""
    a, b, c = body[:3]
    p, q, r = (directions[:, list(body.order)] / body[:3]).T
    X, Y = a * (a - c) * p**2 + b * (b - c) * q**2, b * (a - b) * q**2 + c * (a - c) * r**2
    u = np.log((a - b) * X / ((b - c) * Y))
    return np.sign(u), np.abs(u)


def main(path: str) -> None:
    """Print the table."""
    with open_results(path) as results:
        name = next(iter(results.cases))
        swept = Swept.of(name, results.cases)
        sphere = swept.sphere()
        other = next(axis for axis in swept.axes if axis != sphere)
        full = swept.values("crossing_time", [other, sphere], {})
        body = Body.of(swept.case.data["inertia"])
        directions = swept.axis(sphere).directions(np.arange(full.shape[1]))
        end, spent = swept.case.time.end, float(results.cases[name].attrs["run_time"])
    print(f"{full.size} full motions: {spent:.2f} s")
    began, side_and_u = perf_counter(), shapes(body, directions)
    lams = [[damping_of(swept, other, i)[axis] for axis in body.order] for i in range(len(full))]
    averaged = np.array([tabulated_times(lam, *side_and_u) for lam in lams])
    print(f"{full.size} averaged times: {perf_counter() - began:.3f} s, {len(full)} tables")
    print("damping  crossed: full, averaged  judged otherwise  median, 90 % of |t* - t|")
    for lam, times, ours in zip(lams, full, averaged, strict=True):
        theirs, mine = times <= end, ours <= end
        both = np.abs(ours - times)[theirs & mine]
        middle, most = np.quantile(both, (0.5, 0.9)) if len(both) else (np.nan, np.nan)
        print(
            f"{lam}  {theirs.mean():.4f} {mine.mean():.4f}  {np.mean(theirs != mine):.4f}"
            f"  {middle:.3g} {most:.3g}"
        )


if __name__ == "__main__":
    main(sys.argv[1])
