"""The packet reader in plain Python: slow, readable, and what the tests hold `packet_kernels.scan` to."""

from sensors.packet_kernels import KINDS, PAYLOAD, PREAMBLE


def is_head(data: bytes, at: int) -> bool:
    """Whether a legal packet head (0xFF, type, length) stands at `at`."""
    if at + 3 > len(data) or data[at] != PREAMBLE or data[at + 1] >= KINDS:
        return False
    size = int(PAYLOAD[data[at + 1]])
    return data[at + 2] >= 2 if size == 0 else data[at + 2] == size + 1


def is_packet(data: bytes, at: int) -> bool:
    """Whether a whole packet with a right check stands at `at`."""
    if not is_head(data, at):
        return False
    end = at + 3 + data[at + 2]
    return end <= len(data) and (sum(data[at + 2 : end - 1]) & 0xFF) == data[end - 1]


def could_follow(data: bytes, at: int) -> bool:
    """Whether `at` is the end, unwritten zeros or another head."""
    return at >= len(data) or data[at] == 0 or is_head(data, at)


def is_explained_better(data: bytes, at: int) -> bool:
    """Whether valid packets inside the one at `at` make it an accident (see `packet_kernels._better`)."""
    end = at + 3 + data[at + 2]
    text = int(PAYLOAD[data[at + 1]]) == 0
    if not text and any(is_packet(data, other) and other + 3 + data[other + 2] == end for other in range(at + 1, end)):
        return True
    if not text and (end >= len(data) or is_head(data, end)):
        return False
    for other in range(at + 1, end - 1):
        if is_packet(data, other):
            reach = other + 3 + data[other + 2]
            while reach < end and is_packet(data, reach):
                reach += 3 + data[reach + 2]
            fixed = int(PAYLOAD[data[other + 1]]) > 0
            reads = max(data[other + 3 : other + 2 + data[other + 2]]) < 128
            if text or (reach > end and (fixed or (reads and could_follow(data, reach)))):
                return True
    return False


def shares_its_check(data: bytes, end: int) -> bool:
    """Whether the check before `end` is also the preamble of a packet whose own preamble was lost: both are good."""
    if is_head(data, end) or not is_packet(data, end - 1):
        return False
    return int(PAYLOAD[data[end]]) > 0 or could_follow(data, end + 2 + data[end + 1])


def scan(data: bytes) -> list[int]:
    """Return where the packets of a whole log begin.

    A packet whose check is right is still refused where other valid packets explain its bytes better.
    """
    starts, at = [], 0
    while at < len(data):
        if is_packet(data, at) and not is_explained_better(data, at):
            starts.append(at)
            at += 3 + data[at + 2]
            at -= shares_its_check(data, at)
        else:
            at += 1
    return starts
