"""The observer as a stream, with a road map on board: the bits of the batch, and memory that does not grow."""

import gc
import tracemalloc

import numpy as np
import pytest
from synthetic import SMART, Truth, drive, sense

from observer.observe import observe
from observer.stream import Observer
from sensors.log import SensorLog
from sensors.roadmap import RoadMap

DURATION = 150.0
"""s."""


def along(truth: Truth) -> RoadMap:
    """The road that `truth` drives, a node every 50 m, as one way; the plane is that of `synthetic.sense`."""
    at = np.arange(0.0, truth.distance[-1], 50.0)
    rising = np.concatenate([[True], np.diff(truth.distance) > 0.0])
    north, east, altitude = (
        np.interp(at, truth.distance[rising], values[rising]) for values in (truth.north, truth.east, truth.altitude)
    )
    return RoadMap(
        latitude=49.6 + np.degrees(north / 6_378_600.0),
        longitude=6.1 + np.degrees(east / (6_390_000.0 * np.cos(np.radians(49.6)))),
        way_start=np.array([0, len(at)]),
        way_nodes=np.arange(len(at)),
        elevation_start=np.array([0, len(at)]),
        elevation=altitude,
    )


def packet_by_packet(log: SensorLog) -> list[tuple[str, np.ndarray]]:
    """The log's packets one at a time, as they stand on the card."""
    packets = [(name, packets[i : i + 1]) for name, packets in log.streams.items() for i in range(len(packets))]
    return sorted(packets, key=lambda item: item[1]["order"][0])


@pytest.fixture(scope="module")
def truth() -> Truth:
    return drive(seed=4, duration=DURATION)


@pytest.fixture(scope="module")
def log(truth: Truth) -> SensorLog:
    return sense(truth, seed=4)


def test_stream_with_a_road_map_gives_the_bits_of_the_batch(log, truth):
    road = along(truth)
    batch = observe(log, SMART, road)
    observer = Observer(SMART, road)
    updates = [observer.update(name, packet) for name, packet in packet_by_packet(log)]
    updates.append(observer.finish())
    records = np.concatenate([update.records for update in updates])
    told = np.unique(records["kind"])
    assert {"map_heading", "map_altitude", "map_straightness"} <= set(told.tolist())
    assert np.count_nonzero(records["kind"] == "map_altitude") > 10
    np.testing.assert_array_equal(np.concatenate([update.time for update in updates]), batch.time)
    np.testing.assert_array_equal(np.concatenate([update.state for update in updates]), batch.state)
    np.testing.assert_array_equal(np.concatenate([update.variance for update in updates]), batch.variance)
    for name in ("t", "kind", "innovation", "nis", "reason"):
        np.testing.assert_array_equal(records[name], batch.records[name])


def test_memory_of_the_stream_does_not_grow(log, truth):
    """Given updates that nobody keeps, then as much memory is in use after 3,000 packets as after 1,000."""
    observer = Observer(SMART, along(truth))
    packets = packet_by_packet(log)
    assert len(packets) > 3_000
    used = []
    tracemalloc.start()
    try:
        for count, (name, packet) in enumerate(packets[:3_000], start=1):
            observer.update(name, packet)
            if count in (1_000, 3_000):
                gc.collect()
                used.append(tracemalloc.get_traced_memory()[0])
    finally:
        tracemalloc.stop()
    assert used[1] - used[0] < 20_000
