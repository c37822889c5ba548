"""Other ways to measure fuel (seed 004, 2.3.4.2, notes 9 and 10): volume and temperature, air mass and oxygen.

Both give the stream `fuel` of `sensors.log` (W at 10 Hz) and work for direct injection and diesel, where a pulse's
width does not tell the fuel.
"""

import numpy as np
from numpy.typing import NDArray

from sensors.log import STREAMS
from vehicle_model.car.parameters import Car
from vehicle_model.car.randomness import generator
from vehicle_model.car.trip import Trip

RATE = 10.0
REFERENCE_TEMPERATURE = 288.15
"""K, at which a fuel's density is declared (15 degC)."""
EXPANSION = 0.95e-3
"""1/K, of petrol's volume."""
AIR_RATIO = 14.6
"""kg of air to 1 kg of petrol, stoichiometric."""


def density_at(density: float, temperature: NDArray[np.float64]) -> NDArray[np.float64]:
    """Density (kg/m3) of petrol of `density` at 15 degC at a `temperature` (K): note 9's correction."""
    return density / (1.0 + EXPANSION * (np.asarray(temperature) - REFERENCE_TEMPERATURE))


def power_from_volume(
    flow: NDArray[np.float64], car: Car, temperature: NDArray[np.float64] | None = None
) -> NDArray[np.float64]:
    """Fuel power (W) of a volume flow (m3/s); without the fuel's `temperature` (K) it is taken to be 15 degC."""
    density = car.fuel.density if temperature is None else density_at(car.fuel.density, temperature)
    return np.asarray(flow) * density * car.fuel.heating_value


def power_from_air(
    air: NDArray[np.float64], oxygen_ratio: NDArray[np.float64], car: Car, air_ratio: float = AIR_RATIO
) -> NDArray[np.float64]:
    """Fuel power (W) of an air mass flow (kg/s) and the oxygen sensor's lambda (note 10).

    Note that lambda far from 1 while the fuel is cut makes the power vanish by itself.
    """
    return np.asarray(air) / (np.asarray(oxygen_ratio) * air_ratio) * car.fuel.heating_value


def fuel_temperature(t: NDArray[np.float64], ambient: float = 288.15, warm: float = 308.15) -> NDArray[np.float64]:
    """Temperature (K) in the fuel line: from `ambient` towards `warm` with 20 minutes, as the tank heats up."""
    return warm + (ambient - warm) * np.exp(-t / 1200.0)


def volume_meter(trip: Trip, car: Car, seed: int, *, thermometer: bool = True, accuracy: float = 0.01) -> NDArray:
    """Readings (n,) of STREAMS["fuel"] from a flow meter in the fuel line, with or without a thermometer beside it.

    Noise `accuracy` of the reading, and 0.01 l/h; the meter averages over its 0.1 s. Without the thermometer the fuel's
    expansion (1.9 % for 20 K) stays in the figure.
    """
    t = np.arange(trip.time[0] + 1.0 / RATE, trip.time[-1], 1.0 / RATE)
    rng = generator(seed, "sensors.fuel.volume")
    temperature = fuel_temperature(t)
    burnt = np.diff(np.interp(np.concatenate(([t[0] - 1.0 / RATE], t)), trip.time, trip.fuel_energy)) * RATE
    flow = burnt / (density_at(car.fuel.density, temperature) * car.fuel.heating_value)
    flow = flow * (1.0 + accuracy * rng.standard_normal(t.size)) + 0.01e-3 / 3600.0 * rng.standard_normal(t.size)
    known = temperature + 0.5 * rng.standard_normal(t.size) if thermometer else None
    return _rows(t, power_from_volume(np.maximum(flow, 0.0), car, known))


def air_meter(trip: Trip, car: Car, seed: int, accuracy: float = 0.02, delay: float = 0.08) -> NDArray:
    """Readings (n,) of STREAMS["fuel"] from a hot-film air meter and a wide-band oxygen sensor.

    The meter's scale is off by up to `accuracy` (a property of the seed's car) and both lag: the air by the manifold's
    filling (`delay`, s), lambda by another 0.15 s, so that a change of load shows late.
    """
    t = np.arange(trip.time[0] + 1.0 / RATE, trip.time[-1], 1.0 / RATE)
    rng = generator(seed, "sensors.fuel.air")
    scale = 1.0 + accuracy * rng.uniform(-1.0, 1.0)
    pumped = 0.15e-3 * np.interp(t - delay, trip.time, trip.engine_speed) / 100.0
    fuel = np.interp(t - delay, trip.time, trip.fuel_power) / car.fuel.heating_value
    air = np.maximum(fuel * AIR_RATIO, pumped) * scale * (1.0 + 0.01 * rng.standard_normal(t.size))
    late = np.interp(t - delay - 0.15, trip.time, trip.fuel_power) / car.fuel.heating_value
    moved = np.interp(t - delay - 0.15, trip.time, trip.engine_speed) * 0.15e-5
    ratio = np.minimum(np.maximum(late * AIR_RATIO, moved) / np.maximum(late * AIR_RATIO, 1e-9), 30.0)
    return _rows(t, power_from_air(air, ratio, car))


def _rows(t: NDArray[np.float64], power: NDArray[np.float64]) -> NDArray:
    rows = np.zeros(t.size, dtype=STREAMS["fuel"])
    rows["order"], rows["t"], rows["power"] = np.arange(t.size), t, power
    return rows
