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


def scan(data: bytes) -> list[int]:
    """Return where the packets of a whole log begin.

    A packet whose check is right is still refused if no packet follows it while a better one overlaps its end.
    """
    starts, at = [], 0
    while at < len(data):
        if is_packet(data, at):
            end = at + 3 + data[at + 2]
            better = not (end >= len(data) or is_head(data, end)) and any(
                is_packet(data, other)
                and other + 3 + data[other + 2] > end
                and could_follow(data, other + 3 + data[other + 2])
                for other in range(at + 1, end)
            )
            if not better:
                starts.append(at)
                at = end
                continue
        at += 1
    return starts
