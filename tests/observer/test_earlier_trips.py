"""What several trips learnt, carried over to the next."""

import numpy as np
import pytest

from observer.earlier_trips import carried_over
from observer.observe import LEARNT
from observer.settings import DEFAULT


def trip(bias: float, deviation: float) -> dict[str, float]:
    """What a trip learnt that saw `bias` (m/s2), known to `deviation`."""
    return {"bias_x": bias, "bias_x_variance": deviation**2}


def test_biases_of_trips_known_alike_are_averaged():
    """Given four trips that knew their bias equally well, then the mean is carried over, and is half as uncertain."""
    change = DEFAULT.bias_trip_deviation
    carried = carried_over([trip(b, 0.0) for b in (0.08, 0.10, 0.12, 0.14)])
    assert carried["bias_x"] == pytest.approx(0.11)
    assert carried["bias_x_variance"] == pytest.approx(change**2 / 4.0)


def test_a_trip_that_knew_little_counts_little():
    """Given a long trip and one that hardly knew its bias, then what is carried over is the long one's."""
    carried = carried_over([trip(0.05, 0.002), trip(0.3, 0.2)])
    assert carried["bias_x"] == pytest.approx(0.05, abs=0.003)


def test_trips_of_a_box_foretell_the_next_as_well_as_they_claim():
    """Given boxes whose bias changes from trip to trip, then the error of what is carried over has its variance."""
    rng = np.random.default_rng(0)
    errors = []
    for _ in range(4000):
        own = rng.normal(0.0, 0.1)
        seen = own + DEFAULT.bias_trip_deviation * rng.standard_normal(4)
        found = carried_over([trip(b, 0.0) for b in seen[:3]])
        errors.append((found["bias_x"] - seen[3]) ** 2 / (found["bias_x_variance"] + DEFAULT.bias_trip_deviation**2))
    assert np.mean(errors) == pytest.approx(1.0, abs=0.08)


def test_without_trips_nothing_is_carried_over():
    """Given no earlier trip, then nothing is known; given one, then its own values are handed on."""
    assert carried_over([]) == {}
    one = {name: 0.01 * place for place, name in enumerate(LEARNT)}
    one |= {f"{name}_variance": 1e-6 for name in LEARNT}
    assert {name: carried_over([one])[name] for name in LEARNT} == pytest.approx({name: one[name] for name in LEARNT})
