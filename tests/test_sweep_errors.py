"""The errors of a sweep with more members than are measured against a reference."""

import numpy as np

import hodo_cli as hodo

BODY = {
    "model": "torques",
    "inertia": [3.22, 2.5, 1],
    "kappa": 0.02,
    "brake": 0.01,
    "initial": {"p": 0, "q": 0, "G": 1},
    "time": {"end": 40},
    "sweep": {"direction": {"sphere": {"count": 200, "seed": 4}}},
}


def test_the_worst_members_are_among_those_measured():
    """The errors of the worst end and of the worst crossing are those by long doubles."""
    many = hodo.sweep(BODY)
    better = hodo.sweep({**BODY, "precision": "extended", "error": "off"})
    assert many.attrs["error_sample"] == 200
    apart = np.linalg.norm(many.omega - better.omega, axis=-1)
    start = np.linalg.norm(many.direction_vector / BODY["inertia"], axis=-1)
    size = np.fmax(np.linalg.norm(better.omega, axis=-1), start)
    times = np.abs(many.crossing_time - better.crossing_time).values
    for errors, true in (
        (many.attrs["error_quantiles"], (apart / size).max()),
        (many.attrs["crossing_error_quantiles"], np.nanmax(times)),
    ):
        assert true / 2 < errors[-1] < 2 * true
