"""Packets of a fuzzer's choosing: a short run of `benchmarks.fuzz_observer`."""

import pytest

from benchmarks.fuzz_observer import HONEST_STAMPS, campaign, failures, subject, survive, tampered
from vehicle_model.car.randomness import generator


def test_no_packet_breaks_the_observer_for_good():
    """States stay finite, the covariance positive; 30 s of clean packets bring the clean error back."""
    events, logs, broken = campaign(250_000, HONEST_STAMPS)
    assert events >= 250_000
    assert logs >= 9
    assert broken == []


def test_false_stamps_neither_enter_nor_undo_the_covariance():
    _, _, broken = campaign(100_000, ("stamp",))
    assert [why for _, why in broken if {"not finite", "not positive"} & set(why)] == []


@pytest.mark.parametrize("number", [32, 58])
def test_absurd_readings_are_not_taken_for_noise(number):
    """Given half of the accelerometer's readings absurd for a minute, then it is believed again 30 s later."""
    clean = subject()
    log = tampered(clean.log, generator(number, "fuzz_observer"))
    assert failures(survive(log, clean.car, clean.trip, clean.end), clean) == []
