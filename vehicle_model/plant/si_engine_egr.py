"""The "truth" for seed 003: a turbocharged SI engine with low-pressure EGR, run over a drive cycle of speed and valves.

It shares no equation code with `observer.selection.engine` and has what a linear mean-value model lacks: burnt gas that
travels as a plug from the joint to the throttle, pulses of firing in the exhaust, a volumetric efficiency that depends
on speed and pressures, a compressor and a turbine whose efficiencies depend on their operating points, an exhaust gas
temperature with load and with a wall that stores heat, an EGR cooler whose effectiveness falls with flow.
Relations: Eriksson and Nielsen (2014), chapters 7 and 8; Heywood (1988), 6.2 (volumetric efficiency) and 7.6 (pulses).
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
COLUMNS = 20
"""States recorded, in the order of `observer.selection.engine.STATES`, which takes them as its reference."""
DELAY_CELLS = 400
_GAS, _GAMMA = 287.0, 1.4


@njit(cache=True)
def _nozzle(area, p_up, t_up, p_down):
    """kg/s through a nozzle, linear within 0.2 % of equal pressures, so that flow reverses smoothly."""
    sign = 1.0
    if p_down > p_up:
        p_up, p_down, sign = p_down, p_up, -1.0
    x = p_down / p_up
    critical = (2.0 / (_GAMMA + 1.0)) ** (_GAMMA / (_GAMMA - 1.0))
    share = 1.0
    if x > 0.998:
        share = (1.0 - x) / 0.002
        x = 0.998
    if x < critical:
        x = critical
    function = math.sqrt(2.0 * _GAMMA / (_GAMMA - 1.0) * (x ** (2.0 / _GAMMA) - x ** ((_GAMMA + 1.0) / _GAMMA)))
    return sign * share * area * p_up * function / math.sqrt(_GAS * t_up)


@njit(cache=True)
def _run(state, commands, dt, out, every):
    """Integrate by Euler steps of `dt` (s); `commands` (n, 4): throttle, waste-gate, EGR valve, engine speed."""
    plug = np.full(DELAY_CELLS, state[7])
    filled, wall, angle = 0.0, state[12], 0.0
    p_b, p_i, p_e, p_c, p_t, p_r, spin = state[0], state[1], state[2], state[3], state[4], state[5], state[6]
    f_c, f_b, f_i, f_e, f_t, t_e = state[7], state[8], state[9], state[10], state[11], state[12]
    thr, gate, valve = state[13], state[14], state[15]
    s_a, s_h, s_m, s_d = state[16], state[17], state[18], state[19]
    mean_e, mean_t = p_e, p_t
    for k in range(commands.shape[0]):
        speed = commands[k, 3]
        thr += dt * (commands[k, 0] - thr) / 0.05
        gate += dt * (commands[k, 1] - gate) / 0.1
        valve += dt * (commands[k, 2] - valve) / 0.1
        angle += speed * dt
        rpm = speed * 30.0 / math.pi
        # flows
        air = _nozzle(1.0e-3, 101325.0, 298.0, p_c)
        recycled_open = math.pi * 0.025**2 * (1.0 - math.cos(valve)) * (0.92 + 0.08 * math.cos(3.0 * valve))
        recycled_in = _nozzle(2.2e-4, p_t, 820.0 + 0.1 * (t_e - 1180.0), p_r)
        t_r = 298.0 + 60.0 + 4.0e3 * max(recycled_in, 0.0)
        recycled = _nozzle(recycled_open, p_r, t_r, p_c)
        t_c = (298.0 * max(air, 1e-4) + t_r * max(recycled, 0.0)) / (max(air, 1e-4) + max(recycled, 0.0))
        tip = spin * 0.026
        top = (tip * tip * 1.45 / (2.0 * 1005.0 * t_c) + 1.0) ** 3.5
        swallow = 0.15 * spin / 15000.0
        pi_c = p_b / p_c
        inside = 1.0 - (pi_c / top) ** 2
        blown = swallow * math.sqrt(inside) if inside > 1e-6 else 1e-3 * swallow
        eta_c = 0.73 - 0.25 * (blown / swallow - 0.75) ** 2
        t_b = 308.0 + 80.0 * blown
        through = _nozzle(math.pi * 0.025**2 * (1.0 - math.cos(thr)), p_b, t_b, p_i)
        t_i = t_b + 4.0
        fill = 0.92 - 0.03 * ((rpm - 3400.0) / 1500.0) ** 2 - 0.02 * (p_e / p_i - 1.0)
        taken = fill * p_i * 2.0e-3 * speed / (4.0 * math.pi) / (_GAS * t_i)
        # four cylinders: two exhaust pulses a turn
        burnt = taken * (1.0 + (1.0 - f_i) / 14.7) * (1.0 + 0.6 * math.sin(2.0 * angle))
        expansion = min(p_t / p_e, 0.9999)
        driven = 2.8e-5 * p_e / math.sqrt(t_e) * math.sqrt(1.0 - expansion**1.3)
        jet = math.sqrt(2.0 * 1150.0 * t_e * (1.0 - expansion**0.25))
        blade = spin * 0.024 / max(jet, 50.0)
        eta_t = max(0.70 * (1.0 - ((blade - 0.62) / 0.62) ** 2), 0.3)
        past = _nozzle(math.pi * 0.25 * gate * gate * 0.96, p_e, t_e, p_t)
        out_flow = _nozzle(1.3e-3, p_t, 820.0 + 0.1 * (t_e - 1180.0), 101325.0)
        work = driven * 1150.0 * t_e * eta_t * (1.0 - expansion**0.25)
        work -= blown * 1005.0 * t_c / eta_c * (pi_c ** (1.0 / 3.5) - 1.0) + 3e-7 * spin * spin
        # burnt gas: mixed at the joint, then a plug through the inlet pipe, the cooler and the boost pipe
        f_c += dt * _GAS * t_c / (p_c * 3.0e-3) * (recycled * (f_t - f_c) - air * f_c)
        contents = p_b * 6.0e-3 / (_GAS * t_b)
        filled += dt * max(blown, 0.0) / contents * DELAY_CELLS
        while filled >= 1.0:
            for j in range(DELAY_CELLS - 1, 0, -1):
                plug[j] = plug[j - 1]
            plug[0] = f_c
            filled -= 1.0
        # half of the volume mixes, half travels
        f_b += dt * blown / (0.5 * contents) * (plug[DELAY_CELLS // 2] - f_b)
        f_i += dt * _GAS * t_i / (p_i * 2.5e-3) * through * (f_b - f_i)
        f_e += dt * _GAS * t_e / (p_e * 2.0e-3) * burnt * (1.0 - f_e)
        f_t += dt * _GAS * 850.0 / (p_t * 10e-3) * (driven + past) * (f_e - f_t)
        # pressures, speed, temperature
        p_b += dt * _GAS * t_b / 6.0e-3 * (blown - through)
        p_i += dt * _GAS * t_i / 2.5e-3 * (through - taken)
        p_e += dt * _GAS * t_e / 2.0e-3 * (burnt - driven - past)
        p_c += dt * _GAS * t_c / 3.0e-3 * (air + recycled - blown)
        p_t += dt * _GAS * 850.0 / 10e-3 * (driven + past - out_flow - recycled_in)
        p_r += dt * _GAS * t_r / 1.5e-3 * (recycled_in - recycled)
        spin += dt * work / (2.5e-5 * spin)
        gas = 1080.0 + 0.9 * (p_i - 1.0e5) / 1e3 + 0.04 * (rpm - 3200.0) - 350.0 * f_i
        wall += dt * (gas - wall) / 8.0
        t_e += dt * (0.75 * gas + 0.25 * wall - t_e) / 0.15
        # sensors
        s_a += dt * (air - s_a) / 0.03
        s_h += dt * (blown - s_h) / 0.1
        s_m += dt * (blown - s_m) / 0.06
        s_d += dt * (p_r - p_c - s_d) / 0.02
        # the reference is averaged over the cycle, as the paper's: a running mean over two turns
        turn = dt * speed / (4.0 * math.pi)
        mean_e += turn * (p_e - mean_e)
        mean_t += turn * (p_t - mean_t)
        if k % every == 0:
            row = out[k // every]
            row[0], row[1], row[2], row[3], row[4], row[5], row[6] = p_b, p_i, mean_e, p_c, mean_t, p_r, spin
            row[7], row[8], row[9], row[10], row[11], row[12] = f_c, f_b, f_i, f_e, f_t, t_e
            row[13], row[14], row[15] = thr, gate, valve
            row[16], row[17], row[18], row[19] = s_a, s_h, s_m, s_d


def drive_cycle(duration: float = 40.0, step: float = 2e-4, swing: float = 1.0) -> Array:
    """Commands (n, 4) every `step` s: throttle and firing fixed; steps of waste-gate, EGR valve and ramps of speed.

    As the paper's figure 3: 2400 to 4000 rpm; the valve moves so that EGR spans some 1.5 to 11 %. `swing` scales all
    departures from 3200 rpm, 11.6 mm and 10 degrees.
    """
    t = np.arange(round(duration / step)) * step
    rpm = np.interp(t, np.array([0, 6, 10, 16, 20, 28, 33, 40]) / 40 * duration,
                    [3200, 3200, 4000, 4000, 3200, 2400, 2400, 3000])  # fmt: skip

    def stairs(values: list[float]) -> Array:
        return np.array(values)[np.minimum((t / duration * len(values)).astype(int), len(values) - 1)]

    gate = stairs([11.6, 12.6, 11.6, 10.8, 11.6, 12.2, 11.0, 11.6]) * 1e-3
    valve = np.radians(stairs([10, 12, 8, 13, 6, 10, 5, 11, 9, 12, 7, 10]))
    rpm, gate = 3200.0 + swing * (rpm - 3200.0), 11.6e-3 + swing * (gate - 11.6e-3)
    valve = np.radians(10.0) + swing * (valve - np.radians(10.0))
    return np.column_stack([np.full(t.size, np.radians(60.0)), gate, valve, rpm * np.pi / 30.0])


def run(start: Array, commands: Array, step: float = 2e-4, every: int = 25, settle: float = 10.0) -> Array:
    """Return the states (m, 20), every `every`-th step, of the engine under `commands` (n, 4), from `start` (20,).

    `settle` seconds under the first command come first and are left out. Pressures behind the cylinders are means over
    the cycle.
    """
    rest = np.repeat(commands[:1], round(settle / step), axis=0)
    everything = np.concatenate([rest, commands])
    out = np.empty((-(-len(everything) // every), COLUMNS))
    _run(np.asarray(start, float), everything, step, out, every)
    if not np.all(np.isfinite(out)):
        raise ValueError("si_engine_egr: expected a step and commands under which the engine keeps running")
    return out[len(rest) // every :]
