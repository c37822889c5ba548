"""Units of work for the engine's tests: they succeed, fail, hang and die on request."""

import os
import signal
import time


def square(x: float) -> dict[str, float]:
    return {"square": x * x}


def fail() -> dict[str, float]:
    raise ValueError("no route between the ends")


def hang() -> dict[str, float]:
    time.sleep(3600)
    return {}


def die() -> dict[str, float]:
    os.kill(os.getpid(), signal.SIGKILL)
    return {}


def nap(x: int, seconds: float = 0.7) -> dict[str, int]:
    time.sleep(seconds)
    return {"square": x * x}
