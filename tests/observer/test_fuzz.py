"""Packets of a fuzzer's choosing: a short run of `benchmarks.fuzz_observer`."""

from benchmarks.fuzz_observer import HONEST_STAMPS, campaign


def test_no_packet_breaks_the_observer_for_good():
    """States stay finite, the covariance positive; 30 s of clean packets bring the clean error back."""
    events, logs, broken = campaign(250_000, HONEST_STAMPS)
    assert events >= 250_000
    assert logs >= 9
    assert broken == []


def test_false_stamps_neither_enter_nor_undo_the_covariance():
    _, _, broken = campaign(100_000, ("stamp",))
    assert [why for _, why in broken if {"not finite", "not positive"} & set(why)] == []
