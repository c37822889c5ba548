"""Drives of a world that can be computed by hand, in place of `rollingroad.evaluation.evaluate_drives`.

A trip takes 100 (1 + seed) s at a price of 1,000 W, a hundredth less with each doubling, which costs a hundredth more
fuel: 1 kJ for a second, what it is worth at 1,000 W.
"""

import math
from typing import Any

BASE_FUEL, BASE_TIME = 1e5, 100.0
PERFECT, TRUE = 5000.0, 2000.0
"""J that following exactly and knowing the true map save."""
FIT, ESTIMATION, OPTIMISER = 300.0, 200.0, 100.0


def account(fuel: float, time: float, **more: Any) -> dict[str, Any]:
    return {
        "fuel": fuel, "time": time, "distance": 1e3, "end_energy": 0.0, "efficiency": 0.25, "limit_violations": 0,
        "min_time_to_collision": 4.0, "harsh_braking": 0, "collisions": 0, "red_lights_run": 0, **more,
    }  # fmt: skip


def baseline_drive(task: dict[str, Any]) -> dict[str, Any]:
    scale = 1 + task["seed"]
    return account(BASE_FUEL * scale, BASE_TIME * scale) | {"first_price": task.get("first_price", 400.0)}


def advised_drive(
    task: dict[str, Any], advisor_name: str, knowledge: str, price: float, perfect: bool
) -> dict[str, Any]:
    if task["seed"] == task.get("crash"):
        raise RuntimeError("the ego teleported")
    scale = 1 + task["seed"]
    doublings = math.log2(price / 1000.0)
    fuel = 0.9 * BASE_FUEL + 1000.0 * doublings - PERFECT * perfect - TRUE * (knowledge == "true")
    # In even seeds he is slower than the mean, in odd ones faster: only the mean over two can be equal.
    luck = 1.0 + task.get("luck", 0.0) * (-1) ** task["seed"] / scale
    time = BASE_TIME * (1.0 - 0.01 * doublings) * luck * task.get("slowness", 1.0)
    stored = task.get("stored", 0.0) * scale
    return account(fuel * scale, time * scale, limit_violations=task.get("violations", 0), end_energy=stored)


def planned_losses(task: dict[str, Any], price: float) -> dict[str, float]:
    scale = 1 + task["seed"]
    return {"fit": FIT * scale, "estimation": ESTIMATION * scale, "optimiser": OPTIMISER * scale}
