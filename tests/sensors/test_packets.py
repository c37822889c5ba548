"""The card's format, written and read back, and what the reader makes of damage."""

import itertools
import struct

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from sensors import packet_kernels as kernels
from sensors import packet_reference
from sensors.log import STREAMS
from sensors.packets import BLOCK, Packets, decode, encode, read_log, stream, write_log
from vehicle_model.car.errors import BadInput


def packet(kind: int, payload: bytes) -> bytes:
    """A packet by hand, from the words of the contract."""
    length = len(payload) + 1
    return bytes([0xFF, kind, length]) + payload + bytes([(length + sum(payload)) % 256])


def starts_of(data: bytes) -> list[int]:
    starts = np.empty(len(data) // 5 + 1, dtype=np.int64)
    count, _, _, _ = kernels.scan(
        np.frombuffer(data, np.uint8), True, True, 0, starts, np.zeros(kernels.COUNTERS, np.int64)
    )
    return starts[:count].tolist()


def same(a: dict, b: dict) -> bool:
    return all(a[name].tobytes() == b[name].tobytes() for name in STREAMS if name in a or name in b)


def test_each_packet_means_what_the_contract_says():
    data = (
        packet(1, struct.pack("<Ihhh", 1000, 100, -200, 1000))
        + packet(3, struct.pack("<IB", 1001, 7))
        + packet(4, struct.pack("<IH", 1002, 12_000))
        + packet(4, struct.pack("<IH", 1003, 65_535))
        + packet(5, struct.pack("<Ib", 10_000, -2))
    )
    log = decode(data)
    assert log["accelerometer"][0].tolist() == (0, 1.0, 0.980665, -1.96133, 9.80665)
    assert log["wheel"]["t"][0] == pytest.approx(1.001875, abs=1e-12)
    assert log["injector"]["width"].tolist() == pytest.approx([3.0e-3, 16.38375e-3])
    assert log["injector"]["saturated"].tolist() == [False, True]
    assert log["skew"]["gained"][0] == -0.002
    assert [int(log[name]["order"][0]) for name in ("accelerometer", "wheel", "injector", "skew")] == [0, 1, 2, 4]
    assert log.damage == {}


def test_written_packets_are_the_contracts_bytes():
    rows = np.zeros(1, dtype=[("ms", "<u4"), ("sub", "u1")])
    rows["ms"], rows["sub"] = 0x01020304, 5
    assert encode([Packets.of(3, np.zeros(1), rows)]) == bytes(
        [255, 3, 6, 4, 3, 2, 1, 5, (6 + 4 + 3 + 2 + 1 + 5) % 256]
    )


def test_compiled_scan_agrees_with_the_readable_one(card):
    rng = np.random.default_rng(1)
    data = bytearray(card[:6000])
    for place in rng.integers(0, len(data), 60):
        data[place] = rng.integers(0, 256)
    assert starts_of(bytes(data)) == packet_reference.scan(bytes(data))


def test_the_unwritten_tail_is_no_damage_and_the_file_is_whole_blocks(tmp_path, card):
    path = tmp_path / "log.dat"
    write_log(path, card, preallocated=len(card) + 100_000)
    assert path.stat().st_size == len(card) + 100_000
    assert same(read_log(path).streams, decode(card).streams)
    assert read_log(path).damage == {}
    write_log(path, card)
    assert path.stat().st_size % BLOCK == 0
    assert not list(tmp_path.glob("*.part"))


def test_a_log_cut_in_the_middle_loses_only_its_last_packet(card):
    whole = starts_of(card)
    cut = whole[1000] + 5
    log = decode(card[:cut])
    assert sum(len(rows) for name, rows in log.streams.items() if name != "gps") > 0
    assert starts_of(card[:cut]) == whole[:1000]
    assert log.damage["truncated"] == 1


def test_a_block_that_was_never_written_costs_only_what_it_touched(card):
    whole = starts_of(card)
    begin = (len(card) // 2) // BLOCK * BLOCK
    data = card[:begin] + bytes(BLOCK) + card[begin + BLOCK :]
    left = starts_of(data)
    ends = [*whole[1:], len(card)]
    untouched = {a for a, b in zip(whole, ends, strict=True) if b <= begin or a >= begin + BLOCK}
    assert untouched <= set(left)
    damage = decode(data).damage
    assert damage["bytes_skipped"] >= BLOCK


def test_damage_is_counted_by_kind():
    good = packet(3, struct.pack("<IB", 5, 1))
    bad_check = good[:-1] + bytes([good[-1] ^ 1])
    assert decode(good + bad_check + good).damage == {"bad_check": 1, "bytes_skipped": len(good)}
    assert decode(good + b"\xff\x77\x02" + good).damage["unknown_type"] == 1
    assert decode(good + b"\xff\x03\x09" + good).damage["bad_length"] == 1
    assert decode(good + b"rubbish" + good).damage["bad_preamble"] == 1
    assert decode(good + bytes(40) + good).damage == {"zero_run": 1, "bytes_skipped": 40}
    assert decode(packet(0, b"SD card slow\n")).damage == {"error_message": 1}


def test_a_check_right_by_accident_does_not_swallow_a_good_packet():
    good = packet(3, struct.pack("<IB", 5, 1))
    # A text packet that lost bytes: its length reaches into the next packet, and the check happens to be right there.
    for text in range(256):
        head = bytes([0xFF, 2, 9, 65, 65, 65, text])
        data = head + good + good
        if packet_reference.is_packet(data, 0):
            break
    else:
        pytest.fail("no such text exists")
    assert len(decode(data)["wheel"]) == 2
    assert decode(data).damage["false_packet"] == 1


def test_a_text_whose_length_was_hit_does_not_swallow_the_packets_behind_it():
    """The length of a text can be anything: one that reaches to a later packet's end, its check right by accident."""
    inside = packet(3, struct.pack("<IB", 0x41424344, 1)) + packet(1, struct.pack("<Ihhh", 77, 10, 20, 1000))
    for letter in range(256):
        fake = bytes([0xFF, 2, 3 + len(inside)]) + b"$G" + bytes([letter]) + inside
        if packet_reference.is_head(fake, 0) and (sum(fake[2:-1]) & 0xFF) == fake[-1]:
            break
    else:
        pytest.fail("no such text exists")
    log = decode(fake + packet(3, struct.pack("<IB", 9, 1)))
    assert len(log["wheel"]) == 2
    assert len(log["accelerometer"]) == 1


def test_a_check_that_stands_in_for_a_lost_preamble_costs_neither_packet():
    first = next(made for k in range(256) if (made := packet(3, struct.pack("<IB", 0x01020304, k)))[-1] == 0xFF)
    second = packet(4, struct.pack("<IH", 0x01020304, 100))
    log = decode(first + second[1:] + packet(3, struct.pack("<IB", 9, 1)))
    assert (len(log["wheel"]), len(log["injector"])) == (2, 1)
    assert log.damage == {"bad_preamble": 1}
    damaged = decode(first + second[1:] + b"\xff\x01\xac" + bytes(range(40, 50)))
    assert (len(damaged["wheel"]), len(damaged["injector"])) == (1, 1)


@pytest.mark.parametrize(("torn", "lost"), [(1, 4), (6, 4), (1, 5), (6, 5)])
def test_a_torn_head_does_not_swallow_the_packet_that_ends_where_it_would_end(torn, lost):
    """Bytes were lost just behind a head, so that a good packet's bytes are its payload, the check right for both."""
    kind, form = (4, "<IH") if lost == 4 else (3, "<IB")
    for ms in range(256):
        good = packet(kind, struct.pack(form, 7_000_000 + ms, 99))
        for junk in range(256):
            torn_head = bytes([0xFF, torn, 11, junk, 1][:lost])
            if packet_reference.is_packet(torn_head + good, 0):
                break
        else:
            continue
        break
    else:
        pytest.fail("no such pair exists")
    before, behind = packet(3, struct.pack("<IB", 9, 1)), packet(5, struct.pack("<Ib", 10, 1))
    log = decode(before + torn_head + good + behind)
    assert len(log["injector" if kind == 4 else "wheel"]) == (1 if kind == 4 else 2)
    assert len(log["skew"]) == 1
    assert len(log["accelerometer"]) == len(log["gyroscope"]) == 0
    assert log.damage == {"false_packet": 1, "bytes_skipped": lost}


def test_a_torn_head_does_not_swallow_a_good_packet_that_damage_follows():
    good = packet(3, struct.pack("<IB", 7_000_001, 99))
    torn_head = next(
        head for junk in range(256) if packet_reference.is_packet((head := bytes([0xFF, 7, 7, 1, junk])) + good[:5], 0)
    )
    log = decode(torn_head + good + b"\xff\x01\xac" + bytes(range(40, 50)))
    assert (len(log["wheel"]), len(log["compass"])) == (1, 0)


def test_bytes_that_are_no_text_do_not_undo_a_good_packet_before_them():
    """Damage behind a packet whose last byte is a preamble and whose check is 2: a text's head, its check right."""
    ms = next(k for k in range(1 << 16) if packet(3, struct.pack("<IB", k, 0xFF))[-1] == 2)
    good, behind = packet(3, struct.pack("<IB", ms, 0xFF)), packet(5, struct.pack("<Ib", 10, 1))
    junk = bytes([5, 0xCD, 0xC0, 0x8D, 0x44])
    right = bytes([sum(junk) & 0xFF])
    assert packet_reference.is_packet(good[-2:] + junk + right, 0)
    log = decode(good + junk + right + behind)
    assert (len(log["wheel"]), len(log["skew"])) == (1, 1)


def test_a_packet_in_the_middle_of_a_payload_is_payload():
    inside = packet(3, struct.pack("<IB", 1, 2))
    outer = packet(1, inside + b"x")
    log = decode(outer + packet(3, struct.pack("<IB", 9, 1)))
    assert (len(log["accelerometer"]), len(log["wheel"])) == (1, 1)
    assert log.damage == {}


_PIECES = st.one_of(
    st.binary(max_size=6),
    st.sampled_from([b"\xff", b"\xff\x02", b"\xff\x01\x0b", b"\xff\x06\x0b", b"\xff\x03\x06", bytes(12)]),
    st.builds(lambda ms, sub: packet(3, struct.pack("<IB", ms, sub)), st.integers(0, 2**32 - 1), st.integers(0, 255)),
    st.builds(lambda body: packet(1, body), st.binary(min_size=10, max_size=10)),
    st.builds(lambda text: packet(2, text), st.binary(min_size=1, max_size=40)),
)


@settings(max_examples=400, deadline=None)
@given(pieces=st.lists(_PIECES, max_size=25), drops=st.lists(st.integers(0, 400), max_size=4))
def test_both_readers_find_the_same_packets_in_torn_ones(pieces, drops):
    data = bytearray(b"".join(pieces))
    for place in drops:
        del data[place : place + 1]
    assert starts_of(bytes(data)) == packet_reference.scan(bytes(data))


@settings(max_examples=150, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    flips=st.lists(st.tuples(st.integers(0, 5999), st.integers(0, 255)), max_size=12),
    zeroed=st.lists(st.tuples(st.integers(0, 5999), st.integers(1, 700)), max_size=2),
    lost=st.one_of(st.none(), st.tuples(st.integers(0, 5999), st.integers(1, 600))),
    noise=st.one_of(st.none(), st.tuples(st.integers(0, 5999), st.binary(max_size=60))),
)
def test_every_undamaged_packet_is_recovered(card, flips, zeroed, lost, noise):
    data = np.frombuffer(card[:6000], np.uint8).copy()
    whole = starts_of(card[:6000])
    source = np.arange(data.size)
    for place, value in flips:
        data[place] = value
    for begin, size in zeroed:
        data[begin : begin + size] = 0
    touched = data != np.frombuffer(card[:6000], np.uint8)
    if lost:
        keep = np.ones(data.size, bool)
        keep[lost[0] : lost[0] + lost[1]] = False
        data, source, touched = data[keep], source[keep], touched[keep]
    if noise:
        place = min(noise[0], data.size)
        extra = np.frombuffer(noise[1], np.uint8)
        data = np.insert(data, place, extra)
        source, touched = np.insert(source, place, [-1] * extra.size), np.insert(touched, place, [True] * extra.size)
    found = set(starts_of(data.tobytes()))
    ends = [*whole[1:], None]
    for begin, end in zip(whole[:-1], ends[:-1], strict=True):
        at = np.flatnonzero(source == begin)
        if at.size == 0:
            continue
        at, size = int(at[0]), end - begin
        intact = at + size <= data.size and not touched[at : at + size].any()
        if intact and np.array_equal(source[at : at + size], np.arange(begin, end)):
            assert at in found
    decode(data)


@settings(max_examples=200, deadline=None)
@given(st.binary(max_size=2000))
def test_anything_can_be_read_without_a_crash(data):
    log = decode(data)
    assert set(log.streams) == set(STREAMS)


@settings(max_examples=25, deadline=None, suppress_health_check=list(HealthCheck))
@given(cuts=st.lists(st.integers(0, 40_000), max_size=40))
def test_a_stream_of_any_pieces_gives_the_same_bits_as_the_whole(card, cuts):
    data = bytearray(card[:40_000])
    data[5000:5200] = bytes(200)
    data[9001] ^= 0x55
    edges = [0, *sorted(cuts), len(data)]
    damage: dict[str, int] = {}
    parts = list(stream((bytes(data[a:b]) for a, b in itertools.pairwise(edges)), damage))
    whole = decode(bytes(data))
    for name in STREAMS:
        pieces = [part[name] for part in parts if name in part]
        joined = np.concatenate(pieces) if pieces else np.empty(0, STREAMS[name])
        assert joined.tobytes() == whole[name].tobytes(), name
    assert damage == whole.damage


def test_a_stream_is_read_in_bounded_memory(card):
    import tracemalloc

    def pieces():
        for _ in range(60):
            for begin in range(0, len(card), 4096):
                yield card[begin : begin + 4096]

    for _ in stream([card[:8192]]):
        pass
    tracemalloc.start()
    for _ in stream(pieces()):
        pass
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 0.05 * 60 * len(card)


def test_no_log_is_told_in_one_line(tmp_path):
    with pytest.raises(BadInput, match="readable log file"):
        read_log(tmp_path / "none.dat")
    (tmp_path / "empty.dat").write_bytes(bytes(1024))
    with pytest.raises(BadInput, match="at least one packet"):
        read_log(tmp_path / "empty.dat")
