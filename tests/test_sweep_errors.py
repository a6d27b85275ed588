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
    "sweep": {"direction": {"sphere": {"count": 60, "seed": 4}}},
}


def test_the_worst_members_are_among_those_measured():
    """The errors of the worst end and of the worst crossing are those by long doubles."""
    many = hodo.sweep(BODY)
    better = hodo.sweep({**BODY, "precision": "extended", "error": "off"})
    assert many.attrs["error_sample"] == 60
    apart = np.linalg.norm(many.omega - better.omega, axis=-1)
    start = np.linalg.norm(many.direction_vector / BODY["inertia"], axis=-1)
    size = np.fmax(np.linalg.norm(better.omega, axis=-1), start)
    times = np.abs(many.crossing_time - better.crossing_time).values
    for errors, true in (
        (many.attrs["error_quantiles"], (apart / size).max()),
        (many.attrs["crossing_error_quantiles"], np.nanmax(times)),
    ):
        assert true / 2 < errors[-1] < 2 * true


def test_errors_of_averaged_members_are_known_with_and_without_a_crossing():
    """Whose crossings are no zeros of a function that has an error of its own."""
    averaged = BODY | {"model": "linear-diag", "form": "averaged", "damping": [0.02, 0.05, 0.03]}
    del averaged["kappa"], averaged["brake"]
    averaged["sweep"] = {"direction": {"sphere": {"count": 40, "seed": 1}}}
    balls = hodo.sweep(averaged)
    crossing = np.isfinite(balls.crossing_time.values)
    assert 0 < crossing.sum() < crossing.size
    assert balls.attrs["error_sample"] == 40
    assert "no measured error" not in balls.attrs["warnings"]
