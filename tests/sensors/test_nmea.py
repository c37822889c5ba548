"""NMEA: the compiled writer and reader against pynmeagps."""

import datetime

import numpy as np
import pynmeagps
import pytest

from sensors import nmea

EPOCH = 1_256_634_000.0


def fixes(count: int = 50, start: float = EPOCH) -> np.ndarray:
    rng = np.random.default_rng(0)
    out = np.zeros(count, dtype=nmea.FIX)
    out["utc"] = start + 0.2 * np.arange(count)
    out["latitude"] = rng.uniform(-80, 80, count)
    out["longitude"] = rng.uniform(-179, 179, count)
    out["altitude"] = rng.uniform(-50, 3000, count)
    out["hdop"], out["quality"], out["satellites"] = 1.2, 1, 9
    out["speed"], out["course"] = rng.uniform(0, 60, count), rng.uniform(0, 2 * np.pi, count)
    return out


def read(text: bytes, piece: int = 10**9):
    reader = nmea.Reader()
    data = np.frombuffer(text, np.uint8)
    found = []
    for begin in range(0, max(len(data), 1), piece):
        part = data[begin : begin + piece]
        last = begin + piece >= len(data)
        found.append(reader.feed(part, np.array([part.size]), np.array([begin]), last)[0])
    return np.concatenate(found), reader.damage


def test_pynmeagps_reads_what_we_write():
    truth = fixes()
    text, _ = nmea.write(truth, np.arange(truth.size) % 5 == 0)
    lines = text.tobytes().splitlines()
    assert len(lines) == 2 * truth.size + 10
    parsed = [pynmeagps.NMEAReader.parse(line + b"\r\n") for line in lines]
    gga = [message for message in parsed if message.msgID == "GGA"]
    rmc = [message for message in parsed if message.msgID == "RMC"]
    for row, g, r in zip(truth, gga, rmc, strict=True):
        assert g.lat == pytest.approx(row["latitude"], abs=1e-7)
        assert g.lon == pytest.approx(row["longitude"], abs=1e-7)
        assert g.alt == pytest.approx(row["altitude"], abs=0.051)
        assert r.spd * 1852 / 3600 == pytest.approx(row["speed"], abs=0.003)
        when = datetime.datetime.combine(r.date, r.time, datetime.UTC).timestamp()
        assert when == pytest.approx(row["utc"], abs=1e-6)


def test_we_read_what_pynmeagps_writes():
    truth = fixes(20)
    text = b""
    for row in truth:
        when = datetime.datetime.fromtimestamp(row["utc"], datetime.UTC)
        place = dict(lat=row["latitude"], NS="N" if row["latitude"] >= 0 else "S", lon=row["longitude"],
                     EW="E" if row["longitude"] >= 0 else "W")  # fmt: skip
        text += pynmeagps.NMEAMessage(
            "GN", "GGA", pynmeagps.GET, time=when.time(), **place, quality=1, numSV=8, HDOP=1.1, alt=row["altitude"],
            altUnit="M", sep=47.0, sepUnit="M", diffAge="", diffStation="",
        ).serialize()  # fmt: skip
        text += pynmeagps.NMEAMessage(
            "GN", "RMC", pynmeagps.GET, time=when.time(), status="A", **place, spd=row["speed"],
            cog=np.degrees(row["course"]), date=when.date(), mv="", mvEW="", posMode="A",
        ).serialize()  # fmt: skip
    found, damage = read(text)
    assert damage == {"bad_sentence": 0, "undated_fix": 0}
    assert found["utc"] == pytest.approx(truth["utc"], abs=1e-6)
    assert found["latitude"] == pytest.approx(truth["latitude"], abs=1e-7)
    assert found["longitude"] == pytest.approx(truth["longitude"], abs=1e-7)


def test_there_and_back_in_pieces_of_any_size():
    truth = fixes()
    text = nmea.write(truth, np.zeros(truth.size, bool))[0].tobytes()
    whole, _ = read(text)
    assert whole["speed"] == pytest.approx(truth["speed"], abs=0.003)
    assert whole["course"] == pytest.approx(truth["course"], abs=1e-4)
    for piece in (1, 7, 64, 500):
        assert read(text, piece)[0].tobytes() == whole.tobytes()


def test_a_damaged_sentence_costs_itself_alone():
    truth = fixes(10)
    text = bytearray(nmea.write(truth, np.zeros(10, bool))[0].tobytes())
    lines = text.split(b"\r\n")
    gga = lines[8]
    at = text.index(gga) + 12
    text[at] ^= 1
    found, damage = read(bytes(text))
    assert damage["bad_sentence"] == 1
    assert found.size == 10
    assert np.isnan(found["altitude"][4])
    assert found["latitude"][4] == pytest.approx(truth["latitude"][4], abs=1e-7)


def test_midnight_turns_the_date_even_where_only_gga_speaks():
    start = datetime.datetime(2010, 12, 31, 23, 59, 59, tzinfo=datetime.UTC).timestamp()
    truth = fixes(12, start)
    text = nmea.write(truth, np.zeros(12, bool))[0].tobytes()
    lines = text.split(b"\r\n")
    only = b"\r\n".join([*lines[:2], *[line for line in lines[2:] if b"GGA" in line], b""])
    found, _ = read(only)
    assert found["utc"] == pytest.approx(truth["utc"], abs=1e-6)


def test_no_fix_is_said_without_inventing_a_place():
    truth = fixes(3)
    truth["quality"][1] = 0
    found, _ = read(nmea.write(truth, np.zeros(3, bool))[0].tobytes())
    assert found["quality"].tolist() == [1.0, 0.0, 1.0]
    assert np.isnan(found["latitude"][1])


def test_a_fix_without_any_date_is_counted_and_not_dated_by_guess():
    text = nmea.write(fixes(4), np.zeros(4, bool))[0].tobytes()
    only = b"\r\n".join(line for line in text.split(b"\r\n") if b"GGA" in line) + b"\r\n"
    found, damage = read(only)
    assert found.size == 0
    assert damage["undated_fix"] == 4


@pytest.mark.parametrize(
    "body",
    ["GPGGA,093000.00,4936.7,N,00607.8,E,1,8,1.1,300.3,M,47.0,M,,,extra",
     "GPGGA,093000.00,4936.7,N,00607.8,E,1,8,abc,1,M,,M,,",
     "GPRMC,093000,A,4936.7,N,00607.8,E,,,271009,,", "GPRMC,x", "GPGGA", "GPGSV,1,1,01,02,03,04,05"],
)  # fmt: skip
def test_odd_sentences_never_crash(body):
    check = 0
    for byte in body.encode():
        check ^= byte
    read(f"${body}*{check:02X}\r\n".encode())
