"""The challenge's own car: a forward simulation that shares no code with the product's plant.

Law of the engine (differs from ours on purpose): mean effective pressures. With bmep = 4 pi T / V_d and the mean piston
speed c_m, fuel = (bmep + fmep(c_m) + pmep(load)) V_d w / (4 pi) / eta_i(w, load). The constants are drawn per car
(`cars.py`), so every case has an engine of its own. The driver follows a speed profile with a first-order wish; gear
changes open the clutch; overrun cuts the fuel; brakes do what the engine cannot.

Hot kernel: everything that it calls stands in this file (numba's cache).
"""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.signal import lfilter

STEP = 0.02
"""s, integration step."""
EVERY = 5
"""Steps between stored samples: 0.1 s."""

CAR_FIELDS = (
    "mass", "wheel_inertia_mass", "c_rr", "cd_a", "rho", "g", "radius", "displacement", "stroke", "engine_inertia",
    "f0", "f1", "f2", "p0", "p1", "eta0", "eta_n", "n0", "eta_l", "t_max", "n_peak", "t_flat", "idle_speed", "redline",
    "eta_gear", "drag_out", "accessory",
)  # fmt: skip
DRIVER_FIELDS = (
    "accel",
    "decel",
    "up_rpm",
    "down_rpm",
    "speed_factor",
    "shift_time",
    "gain",
    "launch_speed",
    "lift_time",
)
EFFECT_FIELDS = (
    "wind_n", "wind_e", "yaw_k", "crr", "tyre_k1", "tyre_d1", "tyre_k2", "tyre_t2", "mass", "cd_a", "rho",
    "cold_k1", "cold_e1", "cold_k2", "cold_t2", "crank_gain", "crank_t", "crank_rpm", "oil_k", "oil_d",
    "acc_power", "ac_power", "ac_period", "ac_duty", "enr_gain", "enr_from", "enr_width", "cut_lost", "idle_gain",
    "lhv", "drift_gain", "drift_n", "drift_t", "drift_wn", "drift_wt", "eta_loss", "eta_gear_no", "launch_slip",
    "shift_extra", "corner", "brake_drag", "brake_heat", "sector_k", "sector_psi", "heat_gain", "low_fan", "wet_k",
    "wet_period", "charge_power", "bearing",
)  # fmt: skip
NEUTRAL = dict.fromkeys(EFFECT_FIELDS, 0.0) | {
    "crr": 1.0, "mass": 1.0, "cd_a": 1.0, "rho": 1.0, "lhv": 1.0, "tyre_d1": 5e3, "tyre_t2": 600.0, "cold_e1": 2e7,
    "cold_t2": 200.0, "crank_t": 40.0, "oil_d": 5e3, "ac_period": 40.0, "ac_duty": 0.5, "enr_from": 0.8,
    "enr_width": 0.01, "drift_n": 250.0, "drift_t": 50.0, "drift_wn": 60.0, "drift_wt": 15.0, "wet_period": 300.0,
}  # fmt: skip
COLUMNS = (
    "time", "s", "speed", "acceleration", "gear", "clutch", "engine_speed", "engine_torque", "burnt", "thrust", "brake",
    "engine_angle", "wheel_distance", "heading", "pitch", "curvature", "altitude", "throttle",
)  # fmt: skip
_I = {name: i for i, name in enumerate(EFFECT_FIELDS)}
WIND_N, WIND_E, YAW_K, CRR, TYRE_K1, TYRE_D1, TYRE_K2, TYRE_T2, MASS, CD_A, RHO = range(11)
COLD_K1, COLD_E1, COLD_K2, COLD_T2, CRANK_GAIN, CRANK_T, CRANK_RPM, OIL_K, OIL_D = range(11, 20)
ACC_POWER, AC_POWER, AC_PERIOD, AC_DUTY, ENR_GAIN, ENR_FROM, ENR_WIDTH, CUT_LOST, IDLE_GAIN = range(20, 29)
LHV, DRIFT_GAIN, DRIFT_N, DRIFT_T, DRIFT_WN, DRIFT_WT, ETA_LOSS, ETA_GEAR_NO, LAUNCH_SLIP = range(29, 38)
SHIFT_EXTRA, CORNER, BRAKE_DRAG, BRAKE_HEAT, SECTOR_K, SECTOR_PSI, HEAT_GAIN, LOW_FAN, WET_K = range(38, 47)
WET_PERIOD, CHARGE_POWER, BEARING = range(47, 50)


@dataclass(frozen=True)
class Road:
    """A route over distance at an even `step` (m): arrays (n,), rad and m; stops (k,) with their waits (s)."""

    step: float
    altitude: NDArray[np.float64]
    pitch: NDArray[np.float64]
    heading: NDArray[np.float64]
    curvature: NDArray[np.float64]
    wish: NDArray[np.float64]
    """m/s, the speed that limit and bends allow."""
    north: NDArray[np.float64]
    east: NDArray[np.float64]
    stops: NDArray[np.float64]
    waits: NDArray[np.float64]
    limit: NDArray[np.float64]


def simulate(
    car: dict[str, float], ratios: NDArray, driver: dict[str, float], road: Road, effects: dict[str, float],
    gusts: NDArray, wobble: NDArray,
) -> dict[str, NDArray]:  # fmt: skip
    """Drive `road` once. `effects` overrides NEUTRAL. `gusts` (m,) scales the wind per second, `wobble` (m,) adds to
    the driver's wish (m/s) per second. Returns COLUMNS at 0.1 s; "burnt" in W of heat (true), before the sensor."""
    p = np.array([{**NEUTRAL, **effects}[name] for name in EFFECT_FIELDS])
    c = np.array([car[name] for name in CAR_FIELDS])
    d = np.array([driver[name] for name in DRIVER_FIELDS])
    out = _drive(
        c, np.asarray(ratios, float), d, p, road.step, road.altitude, road.pitch, road.heading, road.curvature,
        road.wish, road.stops, road.waits, gusts, wobble,
    )  # fmt: skip
    return {name: np.ascontiguousarray(out[:, i]) for i, name in enumerate(COLUMNS)}


@njit(cache=True)
def _fuel(w, torque, c, p, friction, load):
    """W of fuel at engine speed w and torque (before accessories), friction a factor on fmep."""
    vd, cm = c[7], c[8] * w / np.pi
    volume = vd / (4.0 * np.pi)
    fmep = (c[10] + c[11] * cm + c[12] * cm * cm) * friction
    pmep = c[13] * max(0.0, 1.0 - load) ** c[14]
    imep = torque / volume + fmep + pmep
    eta = c[15] * (1.0 - c[16] * (w / c[17] - 1.0) ** 2) * (1.0 - c[18] * max(0.0, load - 0.75) ** 2)
    fuel = max(imep, 0.15e5) * volume * w / max(eta, 0.08)
    if p[ENR_GAIN] != 0.0:
        fuel *= 1.0 + p[ENR_GAIN] / (1.0 + np.exp(-(load - p[ENR_FROM]) / p[ENR_WIDTH]))
    if p[DRIFT_GAIN] != 0.0:
        fuel *= 1.0 + p[DRIFT_GAIN] * np.exp(
            -0.5 * ((w - p[DRIFT_N]) / p[DRIFT_WN]) ** 2 - 0.5 * ((torque - p[DRIFT_T]) / p[DRIFT_WT]) ** 2
        )
    return fuel


@njit(cache=True)
def _drive(c, ratios, d, p, ds, altitude, pitch, heading, curvature, wish, stops, waits, gusts, wobble):
    n_road = len(pitch)
    length = (n_road - 2) * ds
    rows = 60000
    out = np.empty((rows, 18))
    dt, row, k = 0.02, 0, 0
    mass = c[0] * p[MASS]
    r = c[6]
    idle = c[22]
    s, v, w, angle, wheel = 0.0, 0.0, idle, 0.0, 0.0
    gear, clutch, shifting, waiting, next_stop = 1, 0.0, 0.0, 5.0, 0
    since_shift, off_time, heat, brake_heat, moved = 10.0, 0.0, 0.0, 0.0, 0.0
    volume = c[7] / (4.0 * np.pi)
    n_gust, n_wob = len(gusts), len(wobble)
    while s < length and row < rows:
        t = k * dt
        x = s / ds
        i = int(x)
        f = x - i
        theta = pitch[i] * (1 - f) + pitch[i + 1] * f
        psi = heading[i] * (1 - f) + heading[i + 1] * f
        kappa = curvature[i] * (1 - f) + curvature[i + 1] * f
        # --- what the driver wants
        target = min(wish[i] * d[4], wish[min(n_road - 1, i + int(v * 1.5 / ds))] * d[4])
        if v > 4.0:
            target += wobble[min(int(t), n_wob - 1)]
        if next_stop < len(stops):
            left = stops[next_stop] - s
            target = min(target, np.sqrt(max(0.0, 2.0 * d[1] * (left - 1.0))))
            if left < 2.5 and v < 0.7:
                waiting = waits[next_stop]
                next_stop += 1
        if waiting > 0.0:
            waiting -= dt
            target = 0.0
        wanted = d[6] * (target - v)
        ahead = wish[min(n_road - 1, i + int(v * d[8] / ds))] * d[4]
        if next_stop < len(stops) and stops[next_stop] - s < v * d[8]:
            ahead = 0.0
        lift = ahead < 0.8 * v and wanted > -0.7 and target < 1.15 * v and v > 4.0  # foot off before he must brake
        if lift:
            wanted = min(wanted, -0.02)
        wanted = min(max(wanted, -1.3 * d[1]), d[0] * (1.0 - 0.45 * v / 35.0))
        # --- resistances
        gust = gusts[min(int(t), n_gust - 1)]
        wn, we = p[WIND_N] * gust, p[WIND_E] * gust
        along = v + wn * np.cos(psi) + we * np.sin(psi)
        across = -wn * np.sin(psi) + we * np.cos(psi)
        beta = np.arctan2(across, max(along, 3.0))
        area = c[3] * p[CD_A] * (1.0 + p[YAW_K] * beta * beta)
        q = 0.5 * c[4] * p[RHO]
        force = q * area * along * abs(along)
        tyre = p[CRR] + p[TYRE_K1] * np.exp(-moved / p[TYRE_D1]) + p[TYRE_K2] * np.exp(-t / p[TYRE_T2])
        moving = 1.0 if v > 0.05 else 0.0
        roll = mass * c[5] * np.cos(theta) * c[2] * tyre
        side = mass * v * v * kappa
        extra = p[BRAKE_DRAG] + p[BRAKE_HEAT] * brake_heat + p[CORNER] * side * side
        extra += p[SECTOR_K] * v * v * max(0.0, np.cos(psi - p[SECTOR_PSI])) ** 4
        extra += p[BEARING] * v * t / 600.0
        if p[WET_K] != 0.0 and (t % p[WET_PERIOD]) > 0.5 * p[WET_PERIOD]:
            extra += p[WET_K] * v * v
        extra += (p[OIL_K] * (1.0 + v / 20.0)) * np.exp(-moved / p[OIL_D])
        force += (roll + extra) * moving + mass * c[5] * np.sin(theta)
        # --- engine state
        friction = 1.0 + p[COLD_K1] * np.exp(-heat / p[COLD_E1]) + p[COLD_K2] * np.exp(-t / p[COLD_T2])
        cm = c[8] * w / np.pi
        fmep = (c[10] + c[11] * cm + c[12] * cm * cm) * friction
        overrun = -(fmep + c[13]) * volume
        t_max = c[19] * (1.0 - c[21] * (w / c[20] - 1.0) ** 2)
        parasitic = c[26] + p[ACC_POWER]
        if p[AC_POWER] != 0.0 and (t % p[AC_PERIOD]) < p[AC_DUTY] * p[AC_PERIOD]:
            parasitic += p[AC_POWER]
        if v < 8.0:
            parasitic += p[LOW_FAN]
        # --- gears
        if since_shift > 1.5 and shifting <= 0.0 and v > 2.0:
            rpm = v * ratios[gear - 1] / r * 9.549
            eager = min(1.0, max(0.0, wanted / d[0]))
            if gear < len(ratios) and rpm > d[2] * (0.85 + 0.5 * eager) and v * ratios[gear] / r * 9.549 > d[3] * 0.95:
                gear += 1
                shifting = d[5] + p[SHIFT_EXTRA]
                since_shift = 0.0
            elif gear > 1 and rpm < d[3] * (0.9 + 0.35 * eager):
                gear -= 1
                shifting = d[5] + p[SHIFT_EXTRA]
                since_shift = 0.0
        since_shift += dt
        if v < 1.0 and waiting > 0.0:
            gear = 1
        ratio = ratios[gear - 1] / r
        eta = c[24] - p[ETA_LOSS] * (1.0 if p[ETA_GEAR_NO] == 0.0 or p[ETA_GEAR_NO] == gear else 0.0)
        # --- how the engine is coupled
        inertia_m = mass + c[1]
        need = inertia_m * wanted + force
        thrust, brake, burnt, torque, load = 0.0, 0.0, 0.0, 0.0, 0.0
        locked_w = v * ratio
        launch_w = max(idle * 1.25, d[7]) + p[LAUNCH_SLIP]
        if shifting > 0.0 or waiting > 0.0 or (wanted <= 0.0 and locked_w < idle * 1.02):
            clutch = 0.0
            shifting -= dt
            goal = idle if shifting <= 0.0 else max(idle, locked_w)
            torque = c[9] * (goal - w) / 0.15 if shifting > 0 else c[9] * (goal - w) / 0.4
            w += (goal - w) * dt / (0.15 if shifting > 0 else 0.4)
            brake = max(0.0, -need) if wanted <= 0.0 else 0.0
            torque = max(torque, 0.0)
        elif locked_w < launch_w and wanted > 0.0 and gear == 1:
            clutch = 0.5
            w += (launch_w - w) * dt / 0.25
            torque = min(max(need / ratio / eta, 0.0), 0.85 * t_max)
            thrust = torque * ratio * eta
        else:
            clutch = 1.0
            if abs(w - locked_w) > 3.0:
                w += (locked_w - w) * dt / 0.12
            else:
                w = locked_w
            equivalent = c[9] * ratio * ratio
            total = (inertia_m + equivalent) * wanted + force + c[25]
            torque = total / ratio / (eta if total > 0.0 else 1.0 / eta)
            if torque > t_max:
                torque = t_max
            if lift or torque < overrun - parasitic / w:
                torque = overrun - parasitic / w
            through = torque * ratio * (eta if torque > 0.0 else 1.0 / eta) - c[25]
            brake = (
                max(0.0, through - total + c[25])
                if wanted < -0.15 and not lift and through > total - c[25] + 1.0
                else 0.0
            )
            accel = (through - force - brake) / (inertia_m + equivalent)
            thrust = through - equivalent * accel
        # --- fuel
        crank = t < p[CRANK_T]
        idle_now = idle + (p[CRANK_RPM] * (1.0 - t / p[CRANK_T]) / 9.549 if crank else 0.0)
        if clutch == 0.0 and shifting <= 0.0 and w < idle_now:
            w += (idle_now - w) * dt / 0.2
        gross = torque + parasitic / max(w, 30.0)
        load = min(1.0, max(0.0, gross / t_max))
        wants_cut = clutch == 1.0 and torque <= 0.75 * overrun and w > 1.45 * idle
        if clutch == 1.0 and torque <= 0.0 and wanted <= 0.0 and w > 1.35 * idle and torque <= 0.6 * overrun:
            wants_cut = True
        off_time = off_time + dt if wants_cut else 0.0
        if off_time > 0.3:
            burnt = p[CUT_LOST] * _fuel(w, 0.0, c, p, friction, 0.0)
            if burnt == 0.0:
                torque = min(torque, overrun)
        else:
            burnt = _fuel(w, gross, c, p, friction, load)
        if clutch == 0.0 and w < 1.35 * idle:
            burnt *= 1.0 + p[IDLE_GAIN]
        if crank:
            burnt *= 1.0 + p[CRANK_GAIN] * (1.0 - t / p[CRANK_T])
        burnt *= 1.0 + p[HEAT_GAIN] * (heat / 4e7) * max(0.0, load - 0.4)
        if brake > 0.0 and clutch == 1.0:
            burnt += p[CHARGE_POWER] * 2.5
        heat += burnt * dt
        # --- motion
        a = (thrust - force - brake) / inertia_m
        if v <= 0.02 and a < 0.0:
            a, v = 0.0, 0.0
        if k % 5 == 0:
            out[row, 0] = t
            out[row, 1] = s
            out[row, 2] = v
            out[row, 3] = a
            out[row, 4] = gear if clutch > 0.0 else 0
            out[row, 5] = clutch
            out[row, 6] = w
            out[row, 7] = gross
            out[row, 8] = burnt
            out[row, 9] = thrust
            out[row, 10] = brake
            out[row, 11] = angle
            out[row, 12] = wheel
            out[row, 13] = psi
            out[row, 14] = theta
            out[row, 15] = kappa
            out[row, 16] = altitude[i] * (1 - f) + altitude[i + 1] * f
            out[row, 17] = load
            row += 1
        v = max(0.0, v + a * dt)
        s += v * dt
        moved += v * dt
        angle += w * dt
        wheel += v * dt
        brake_heat += dt * (brake / 4000.0 - brake_heat / 60.0)
        k += 1
    return out[:row]


@njit(cache=True)
def _along(c, ratios, p, t, s, v, a, gear, clutch, w, heading, pitch, kappa, heat, moved, brake_heat, cut):
    """Fuel (W) and coasting force (N) that a car under `p` needs for a given motion: each sample solved for itself."""
    n = len(t)
    fuel, coast = np.zeros(n), np.zeros(n)
    r, volume = c[6], c[7] / (4.0 * np.pi)
    mass = c[0] * p[MASS]
    for i in range(n):
        psi = heading[i]
        along = v[i] + p[WIND_N] * np.cos(psi) + p[WIND_E] * np.sin(psi)
        across = -p[WIND_N] * np.sin(psi) + p[WIND_E] * np.cos(psi)
        beta = np.arctan2(across, max(along, 3.0))
        force = 0.5 * c[4] * p[RHO] * c[3] * p[CD_A] * (1.0 + p[YAW_K] * beta * beta) * along * abs(along)
        tyre = p[CRR] + p[TYRE_K1] * np.exp(-moved[i] / p[TYRE_D1]) + p[TYRE_K2] * np.exp(-t[i] / p[TYRE_T2])
        side = mass * v[i] * v[i] * kappa[i]
        extra = (
            p[BRAKE_DRAG] + p[BRAKE_HEAT] * brake_heat[i] + p[CORNER] * side * side + p[BEARING] * v[i] * t[i] / 600.0
        )
        extra += p[SECTOR_K] * v[i] ** 2 * max(0.0, np.cos(psi - p[SECTOR_PSI])) ** 4
        if p[WET_K] != 0.0 and (t[i] % p[WET_PERIOD]) > 0.5 * p[WET_PERIOD]:
            extra += p[WET_K] * v[i] * v[i]
        extra += p[OIL_K] * (1.0 + v[i] / 20.0) * np.exp(-moved[i] / p[OIL_D])
        if v[i] > 0.05:
            force += mass * c[5] * np.cos(pitch[i]) * c[2] * tyre + extra
        force += mass * c[5] * np.sin(pitch[i])
        friction = 1.0 + p[COLD_K1] * np.exp(-heat[i] / p[COLD_E1]) + p[COLD_K2] * np.exp(-t[i] / p[COLD_T2])
        parasitic = c[26] + p[ACC_POWER]
        if p[AC_POWER] != 0.0 and (t[i] % p[AC_PERIOD]) < p[AC_DUTY] * p[AC_PERIOD]:
            parasitic += p[AC_POWER]
        if v[i] < 8.0:
            parasitic += p[LOW_FAN]
        torque = 0.0
        t_max = c[19] * (1.0 - c[21] * (w[i] / c[20] - 1.0) ** 2)
        if gear[i] > 0.0:
            ratio = ratios[int(gear[i]) - 1] / r
            eta = c[24] - p[ETA_LOSS] * (1.0 if p[ETA_GEAR_NO] == 0.0 or p[ETA_GEAR_NO] == gear[i] else 0.0)
            total = (mass + c[1] + c[9] * ratio * ratio) * a[i] + force + c[25]
            torque = total / ratio / (eta if total > 0.0 else 1.0 / eta)
            cm = c[8] * w[i] / np.pi
            overrun = -((c[10] + c[11] * cm + c[12] * cm * cm) * friction + c[13]) * volume
            coast[i] = -(force + (mass + c[1]) * a[i]) + (overrun - parasitic / w[i]) * ratio / eta
        gross = torque + parasitic / max(w[i], 30.0)
        load = min(1.0, max(0.0, gross / t_max))
        burnt = (
            p[CUT_LOST] * _fuel(w[i], 0.0, c, p, friction, 0.0) if cut[i] else _fuel(w[i], gross, c, p, friction, load)
        )
        if clutch[i] == 0.0 and w[i] < 1.35 * c[22]:
            burnt *= 1.0 + p[IDLE_GAIN]
        if t[i] < p[CRANK_T]:
            burnt *= 1.0 + p[CRANK_GAIN] * (1.0 - t[i] / p[CRANK_T])
        burnt *= 1.0 + p[HEAT_GAIN] * (heat[i] / 4e7) * max(0.0, load - 0.4)
        fuel[i] = burnt
    return fuel, coast


def along(
    car: dict[str, float], ratios: NDArray, effects: dict[str, float], drive: dict[str, NDArray]
) -> tuple[NDArray, NDArray]:
    """Fuel (W) and coasting force (N) at each sample of `drive` if the same motion were driven under `effects`."""
    p = np.array([{**NEUTRAL, **effects}[name] for name in EFFECT_FIELDS])
    c = np.array([car[name] for name in CAR_FIELDS])
    h = STEP * EVERY
    heat = np.cumsum(drive["burnt"]) * h
    memory = lfilter([h / 4000.0], [1.0, -(1.0 - h / 60.0)], drive["brake"])
    return _along(
        c, np.asarray(ratios, float), p, drive["time"], drive["s"], drive["speed"], drive["acceleration"],
        drive["gear"],
        drive["clutch"], drive["engine_speed"], drive["heading"], drive["pitch"], drive["curvature"], heat, drive["s"],
        memory, drive["burnt"] <= 0.0,
    )  # fmt: skip
