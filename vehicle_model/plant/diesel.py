"""A truck diesel with variable-geometry turbine and EGR: the benchmark engine of seeds 001 and 002.

Equations of Wahlström and Eriksson (2011), their section 3 to 8, without the two oxygen states (they act on nothing
else): three gas-exchange states (p_im, p_em, omega_t), and three of the actuators, which a reduced model leaves out.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.optimize import fsolve

from vehicle_model.car.diesel_engine import DieselParameters
from vehicle_model.car.randomness import generator

STATES = ("p_im", "p_em", "omega_t")
"""Intake and exhaust manifold pressure (Pa), turbine speed (rad/s)."""
INPUTS = ("u_delta", "n_e", "u_egr", "u_vgt")
"""Fuel (mg per cycle and cylinder), engine speed (rpm), EGR valve and VGT position (%, 100 is open)."""
FLOWS = ("W_c", "W_egr", "W_ei", "W_t", "T_em", "M_e")
"""kg/s, kg/s, kg/s, kg/s, K, N m."""


@dataclass(frozen=True)
class DieselRun:
    """A simulated run, arrays over time (n,)."""

    time: NDArray[np.float64]
    inputs: NDArray[np.float64]
    """(n, 4), INPUTS."""
    state: NDArray[np.float64]
    """(n, 3), STATES."""
    flows: NDArray[np.float64]
    """(n, 6), FLOWS."""


@njit(cache=True)
def _gas_exchange(x, u, p):  # pragma: no cover - compiled
    """Rates of (p_im, p_em, omega_t), then FLOWS. `x` (3,), `u` (4,) at the valves, `p` DieselParameters."""
    p_im, p_em, w_t = x[0], x[1], x[2]
    u_delta, n_e, u_egr, u_vgt = u[0], u[1], u[2], u[3]

    # cylinder flows
    eta_vol = p.c_vol1 * np.sqrt(p_im) + p.c_vol2 * np.sqrt(n_e) + p.c_vol3
    W_ei = eta_vol * p_im * n_e * p.V_d / (120.0 * p.R_a * p.T_im)
    W_f = 1e-6 / 120.0 * u_delta * n_e * p.n_cyl
    W_eo = W_f + W_ei

    # exhaust temperature: ideal Seliger cycle with residual gas, a fixed point in x_r and T_1
    Pi_e = p_em / p_im
    x_r, T_1, T_e = 0.0, p.T_im, p.T_im
    compression = p.r_c ** (p.gamma_a - 1.0)
    for _ in range(12):
        q_in = W_f * p.q_HV / W_eo * (1.0 - x_r)
        x_p = 1.0 + q_in * p.x_cv / (p.c_va * T_1 * compression)
        x_v = 1.0 + q_in * (1.0 - p.x_cv) / (p.c_pa * (q_in * p.x_cv / p.c_va + T_1 * compression))
        x_r = Pi_e ** (1.0 / p.gamma_a) * x_p ** (-1.0 / p.gamma_a) / (p.r_c * x_v)
        heat = q_in * ((1.0 - p.x_cv) / p.c_pa + p.x_cv / p.c_va) + T_1 * compression
        T_e = p.eta_sc * Pi_e ** (1.0 - 1.0 / p.gamma_a) / compression * x_p ** (1.0 / p.gamma_a - 1.0) * heat
        T_1 = x_r * T_e + (1.0 - x_r) * p.T_im
    wall = p.h_tot * np.pi * p.d_pipe * p.l_pipe * p.n_pipe
    T_em = p.T_amb + (T_e - p.T_amb) * np.exp(-wall / (W_eo * p.c_pe))

    # EGR valve: parabolic flow function, no backflow
    ratio = min(max(p_im / p_em, p.PI_egropt), 1.0)
    Psi_egr = 1.0 - ((1.0 - ratio) / (1.0 - p.PI_egropt) - 1.0) ** 2
    u_open = min(max(u_egr, 0.0), -p.c_egr2 / (2.0 * p.c_egr1))  # the actuator overshoots, the valve has a stop
    f_egr = p.c_egr1 * u_open**2 + p.c_egr2 * u_open + p.c_egr3
    W_egr = p.A_egrmax * f_egr * p_em * Psi_egr / np.sqrt(T_em * p.R_e)

    # turbine
    Pi_t = min(p.p_amb / p_em, 1.0)
    f_vgt = p.c_f2 + p.c_f1 * np.sqrt(max(0.0, 1.0 - ((u_vgt - p.c_vgt2) / p.c_vgt1) ** 2))
    W_t = p.A_vgtmax * max(f_vgt, 0.0) * p_em * np.sqrt(1.0 - Pi_t**p.K_t) / np.sqrt(T_em * p.R_e)
    drop = max(1.0 - Pi_t ** (1.0 - 1.0 / p.gamma_e), 1e-9)
    BSR = p.R_t * w_t / np.sqrt(2.0 * p.c_pe * T_em * drop)
    if w_t > p.w_tlin:
        c_m = p.c_m1 * (w_t - p.c_m2) ** p.c_m3
    else:  # the printed power has an infinite slope at c_m2: linear below w_tlin
        c_m = p.c_mlin * max(0.0, w_t - p.c_m2) / (p.w_tlin - p.c_m2)
    eta_tm = max(p.eta_tmmax - c_m * (BSR - p.BSR_opt) ** 2, 0.2)
    P_t = eta_tm * W_t * p.c_pe * T_em * drop

    # compressor: an ellipse in head and flow coefficient
    Pi_c = p_im / p.p_amb
    head = Pi_c ** (1.0 - 1.0 / p.gamma_a) - 1.0
    Psi_c = 2.0 * p.c_pa * p.T_amb * head / (p.R_c**2 * w_t**2)
    c_psi = p.c_wpsi1 * w_t**2 + p.c_wpsi2 * w_t + p.c_wpsi3
    c_phi = p.c_wphi1 * w_t**2 + p.c_wphi2 * w_t + p.c_wphi3
    Phi_c = np.sqrt(max(0.0, (1.0 - c_psi * Psi_c * abs(Psi_c)) / c_phi))
    W_c = p.p_amb * np.pi * p.R_c**3 * w_t / (p.R_a * p.T_amb) * Phi_c
    off_flow = W_c - p.w_copt
    off_head = max(Pi_c - 1.0, 0.0) ** p.c_pi - p.pi_copt
    eta_c = p.eta_cmax - (p.Q_c11 * off_flow**2 + 2.0 * p.Q_c12 * off_flow * off_head + p.Q_c22 * off_head**2)
    P_c = W_c * p.c_pa * p.T_amb / max(eta_c, 0.2) * head

    # torque
    M_pump = p.V_d / (4.0 * np.pi) * (p_em - p_im)
    M_gross = (
        u_delta * 1e-6 * p.n_cyl * p.q_HV * p.eta_igch * (1.0 - 1.0 / p.r_c ** (p.gamma_cyl - 1.0)) / (4.0 * np.pi)
    )
    n = n_e / 1000.0
    M_fric = p.V_d / (4.0 * np.pi) * 1e5 * (p.c_fric1 * n**2 + p.c_fric2 * n + p.c_fric3)

    return (
        p.R_a * p.T_im / p.V_im * (W_c + W_egr - W_ei),
        p.R_e * T_em / p.V_em * (W_eo - W_t - W_egr),
        (P_t - P_c) / (p.J_t * w_t),
        W_c,
        W_egr,
        W_ei,
        W_t,
        T_em,
        M_gross - M_pump - M_fric,
    )


@njit(cache=True)
def _rates(x, u, p):  # pragma: no cover - compiled
    """Rates of the six states (STATES, then EGR 1, EGR 2, VGT actuator)."""
    at_valves = np.array([u[0], u[1], p.K_egr * x[3] - (p.K_egr - 1.0) * x[4], x[5]])
    gas = _gas_exchange(x[:3], at_valves, p)
    return np.array(
        [gas[0], gas[1], gas[2], (u[2] - x[3]) / p.tau_egr1, (u[2] - x[4]) / p.tau_egr2, (u[3] - x[5]) / p.tau_vgt]
    )


@njit(cache=True)
def _simulate(x, inputs, bias, disturbance, step, substeps, actuators, p):  # pragma: no cover - compiled
    n = len(inputs)
    states, flows = np.empty((n, 3)), np.empty((n, 6))
    lag_egr, lag_vgt = round(p.tau_degr / step), round(p.tau_dvgt / step)
    h = step / substeps
    for k in range(n):
        u = inputs[k].copy()
        if actuators:
            u[2], u[3] = inputs[max(k - lag_egr, 0), 2], inputs[max(k - lag_vgt, 0), 3]
        at_valves = u.copy()
        if actuators:
            at_valves[2], at_valves[3] = p.K_egr * x[3] - (p.K_egr - 1.0) * x[4], x[5]
        states[k] = x[:3]
        flows[k] = np.array(_gas_exchange(x[:3], at_valves, p)[3:])
        shift = np.zeros(6)
        shift[:3] = bias[k]
        for _ in range(substeps):
            if not actuators:
                x[3], x[4], x[5] = u[2], u[2], u[3]
            k1 = _rates(x - shift, u, p)
            k2 = _rates(x - shift + 0.5 * h * k1, u, p)
            k3 = _rates(x - shift + 0.5 * h * k2, u, p)
            k4 = _rates(x - shift + h * k3, u, p)
            x = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        x[:3] += disturbance[k]
    return states, flows


def simulate_diesel(
    inputs: NDArray,
    step: float = 0.01,
    *,
    start: NDArray | None = None,
    bias: NDArray | None = None,
    disturbance: NDArray | None = None,
    actuators: bool = True,
    parameters: DieselParameters | None = None,
) -> DieselRun:
    """Run the engine on `inputs` (n, 4), held over each `step` (s); classical Runge-Kutta at 2.5 ms or finer.

    `start` (3,), by default the stationary state of the first input. `bias` (n, 3) moves the stationary point,
    dx/dt = f(x - bias, u) (seed 001, eq. 3a); `disturbance` (n, 3) is added to the state after each step.
    `actuators` off makes it the three-state model.
    """
    p = parameters or DieselParameters()
    inputs = np.ascontiguousarray(inputs, dtype=float)
    n = len(inputs)
    gas = steady_diesel(inputs[0], parameters=p) if start is None else np.asarray(start, dtype=float)
    x = np.concatenate([gas, [inputs[0, 2], inputs[0, 2], inputs[0, 3]]])
    zero = np.zeros((n, 3))
    substeps = max(1, int(np.ceil(step / 0.0025)))
    states, flows = _simulate(
        x,
        inputs,
        zero if bias is None else np.ascontiguousarray(bias, dtype=float),
        zero if disturbance is None else np.ascontiguousarray(disturbance, dtype=float),
        step,
        substeps,
        actuators,
        p,
    )
    return DieselRun(np.asarray(np.arange(n) * step, float), inputs, states, flows)


def diesel_rates(
    state: NDArray, inputs: NDArray, parameters: DieselParameters | None = None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Rates of STATES (3,) and FLOWS (6,) at one state (3,) and input (4,)."""
    out = np.array(_gas_exchange(np.asarray(state, float), np.asarray(inputs, float), parameters or DieselParameters()))
    return out[:3], out[3:]


def steady_diesel(inputs: NDArray, parameters: DieselParameters | None = None) -> NDArray[np.float64]:
    """Stationary (p_im, p_em, omega_t) for a constant input (4,): settled for 40 s, then Newton's method."""
    p = parameters or DieselParameters()
    u = np.asarray(inputs, dtype=float)
    held = np.tile(u, (4000, 1))
    x = np.array([1.3 * p.p_amb, 1.5 * p.p_amb, 5236.0, u[2], u[2], u[3]])
    zero = np.zeros((len(held), 3))
    settled = _simulate(x, held, zero, zero, 0.01, 4, False, p)[0][-1]
    scale = np.array([1e5, 1e5, 5e3])
    root, _, status, _ = fsolve(lambda z: diesel_rates(z * scale, u, p)[0] / scale, settled / scale, full_output=True)
    return root * scale if status == 1 else settled


def schedule(u_delta: NDArray, n_e: NDArray) -> NDArray[np.float64]:
    """Valve positions of an ordinary calibration, (n, 2): much EGR and a closed turbine at low load."""
    load = np.clip(u_delta / 200.0, 0.0, 1.0)
    speed = np.clip((n_e - 800.0) / 1200.0, 0.0, 1.0)
    u_egr = 55.0 * (1.0 - load) ** 1.5
    u_vgt = 28.0 + 22.0 * load + 18.0 * speed
    return np.stack([u_egr, u_vgt], axis=-1)


def transient_cycle(seed: int, seconds: float = 1800.0, step: float = 0.01) -> NDArray[np.float64]:
    """Inputs (n, 4) of a made-up transient cycle of the European one's build: a third each town, rural and motorway.

    Fuel and speed move between random set points at the rates a truck allows; the valves follow `schedule` with
    a wobble of their own. It is not the regulation's table.
    """
    rng = generator(seed, "diesel transient cycle")
    n = round(seconds / step)
    fuel, speed = np.empty(n), np.empty(n)
    parts = (  # dwell [s], fuel [mg/cycle], speed [rpm], share of time with the foot off
        ((2.0, 9.0), (20.0, 190.0), (750.0, 1700.0), 0.30),
        ((3.0, 15.0), (40.0, 220.0), (1000.0, 1800.0), 0.15),
        ((6.0, 30.0), (70.0, 220.0), (1300.0, 1900.0), 0.05),
    )
    k, fuel_now, speed_now = 0, 30.0, 800.0
    while k < n:
        dwell, fuels, speeds, off = parts[min(3 * k // n, 2)]
        length = int(rng.uniform(*dwell) / step)
        fuel_goal = 12.0 if rng.uniform() < off else rng.uniform(*fuels)
        speed_goal = rng.uniform(*speeds)
        for i in range(k, min(k + length, n)):
            fuel_now += float(np.clip(fuel_goal - fuel_now, -250.0 * step, 150.0 * step))
            speed_now += float(np.clip(speed_goal - speed_now, -220.0 * step, 180.0 * step))
            fuel[i], speed[i] = fuel_now, speed_now
        k += length
    valves = schedule(fuel, speed)
    time = np.arange(n) * step
    valves[:, 0] += 4.0 * np.sin(2.0 * np.pi * time / 47.0)
    valves[:, 1] += 4.0 * np.sin(2.0 * np.pi * time / 31.0)
    return np.column_stack([fuel, speed, np.clip(valves[:, 0], 0.0, 80.0), np.clip(valves[:, 1], 22.0, 100.0)])
