"""One seed, one generator per purpose: adding a sensor never changes another sensor's noise."""

import hashlib

import numpy as np


def generator(seed: int, purpose: str) -> np.random.Generator:
    """Return the random generator of `purpose` ("gps", "driver", ...) under `seed` (a non-negative integer).

    The spawn key is a hash of the purpose's name, so streams are independent of each other and of the order
    in which they are asked for.
    """
    key = int.from_bytes(hashlib.sha256(purpose.encode()).digest()[:4], "little")
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=(key,))))
