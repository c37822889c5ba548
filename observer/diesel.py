"""The observer's model of the benchmark diesel and its filter: three states, Euler steps, biases and a sensor map.

State vector: (p_im, p_em, omega_t) in Pa, Pa, rad/s, then as configured the bias q (seed 001, eq. 3), the
compressor-flow error Delta_W and the nodes theta of the air-flow sensor's error map (seed 002, eq. 4), the last three
constant but for a random walk. The model is the reduction of Wahlström and Eriksson (2011) that the seeds use: no
oxygen states, no actuator dynamics. It is written apart from the plant's, which is richer.
"""

from dataclasses import dataclass, field

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vehicle_model.car.diesel_engine import DieselParameters

AIR_FLOW = 3
"""Index of the compressor's air flow (kg/s) among what can be measured; 0, 1, 2 are the states."""
SCALE = np.array([1e5, 1e5, 5e3])
"""Ordinary size of the states."""


@njit(cache=True)
def compressor_flow(p_im, w_t, p):  # pragma: no cover - compiled
    """W_c, kg/s."""
    lift = (p_im / p.p_amb) ** ((p.gamma_a - 1.0) / p.gamma_a) - 1.0
    tip = p.R_c * w_t
    psi = 2.0 * p.c_pa * p.T_amb * lift / tip**2
    k_psi = p.c_wpsi3 + w_t * (p.c_wpsi2 + w_t * p.c_wpsi1)
    k_phi = p.c_wphi3 + w_t * (p.c_wphi2 + w_t * p.c_wphi1)
    inside = (1.0 - k_psi * psi * abs(psi)) / k_phi
    if inside <= 0.0:
        return 0.0
    return p.p_amb / (p.R_a * p.T_amb) * np.pi * p.R_c**2 * tip * np.sqrt(inside)


@njit(cache=True)
def diesel_rates(p_im, p_em, w_t, extra_flow, u, p):  # pragma: no cover - compiled
    """dx/dt of the three states; `extra_flow` (kg/s) is Delta_W, added to the compressor's."""
    fuel = u[0] * u[1] * p.n_cyl / 120e6
    air = (p.c_vol3 + p.c_vol1 * p_im**0.5 + p.c_vol2 * u[1] ** 0.5) * p_im * u[1] * p.V_d / (120.0 * p.R_a * p.T_im)
    exhaust = fuel + air
    # Seliger cycle without constant-volume combustion (x_cv = 0 in the published values): x_p = 1
    specific = fuel * p.q_HV / exhaust
    squeeze = p.r_c ** (p.gamma_a - 1.0)
    back = p_em / p_im
    residual, charge, hot = 0.03, p.T_im, p.T_im
    for _ in range(5):
        released = specific * (1.0 - residual)
        stretch = 1.0 + released / (p.c_pa * charge * squeeze)
        residual = back ** (1.0 / p.gamma_a) / (p.r_c * stretch)
        hot = p.eta_sc * back ** (1.0 - 1.0 / p.gamma_a) * (released / (p.c_pa * squeeze) + charge)
        charge = p.T_im + residual * (hot - p.T_im)
    cooling = p.h_tot * np.pi * p.d_pipe * p.l_pipe * p.n_pipe / (exhaust * p.c_pe)
    t_em = p.T_amb + (hot - p.T_amb) * np.exp(-cooling)
    choke = p_em / np.sqrt(t_em * p.R_e)

    closed = min(max(p_im / p_em, p.PI_egropt), 1.0)
    loss = (p.PI_egropt - closed) / (1.0 - p.PI_egropt)
    lift = min(max(u[2], 0.0), -0.5 * p.c_egr2 / p.c_egr1)
    egr = p.A_egrmax * (p.c_egr3 + lift * (p.c_egr2 + lift * p.c_egr1)) * choke * (1.0 - loss * loss)

    expansion = min(p.p_amb / p_em, 1.0)
    opening = 1.0 - ((u[3] - p.c_vgt2) / p.c_vgt1) ** 2
    vanes = max(p.c_f2 + p.c_f1 * np.sqrt(max(opening, 0.0)), 0.0)
    turbine = p.A_vgtmax * vanes * choke * np.sqrt(1.0 - expansion**p.K_t)
    enthalpy = max(1.0 - expansion ** ((p.gamma_e - 1.0) / p.gamma_e), 1e-9) * p.c_pe * t_em
    speed_ratio = p.R_t * w_t / np.sqrt(2.0 * enthalpy)
    if w_t > p.w_tlin:
        width = p.c_m1 * (w_t - p.c_m2) ** p.c_m3
    else:
        width = p.c_mlin * max(0.0, (w_t - p.c_m2) / (p.w_tlin - p.c_m2))
    gain = max(p.eta_tmmax - width * (speed_ratio - p.BSR_opt) ** 2, 0.2) * turbine * enthalpy

    flow = compressor_flow(p_im, w_t, p)
    boost = p_im / p.p_amb
    dw, dpi = flow - p.w_copt, max(boost - 1.0, 0.0) ** p.c_pi - p.pi_copt
    good = max(p.eta_cmax - dw * (p.Q_c11 * dw + 2.0 * p.Q_c12 * dpi) - p.Q_c22 * dpi * dpi, 0.2)
    spent = flow * p.c_pa * p.T_amb * (boost ** ((p.gamma_a - 1.0) / p.gamma_a) - 1.0) / good
    return (
        p.R_a * p.T_im / p.V_im * (flow + extra_flow + egr - air),
        p.R_e * t_em / p.V_em * (exhaust - turbine - egr),
        (gain - spent) / (p.J_t * w_t),
    )


@njit(cache=True)
def diesel_jacobian(x, extra_flow, u, p):  # pragma: no cover - compiled
    """d(dx/dt)/dx (3, 3) by central differences of one part in 1e4 of the states' ordinary size."""
    jacobian = np.empty((3, 3))
    for j in range(3):
        h = 10.0 if j < 2 else 0.5
        up, down = x.copy(), x.copy()
        up[j] += h
        down[j] -= h
        high = diesel_rates(up[0], up[1], up[2], extra_flow, u, p)
        low = diesel_rates(down[0], down[1], down[2], extra_flow, u, p)
        for i in range(3):
            jacobian[i, j] = (high[i] - low[i]) / (2.0 * h)
    return jacobian


@njit(cache=True)
def limit_covariance(P, first, limit):  # pragma: no cover - compiled
    """Limit the variances P[i, i], i >= first, to limit[i - first] by scaling row and column i together, in place.

    Seed 002, 3.1 sets the diagonal alone, which can leave P indefinite (ERRATA): D P D with a diagonal D cannot.
    """
    n = len(P)
    for i in range(first, n):
        if P[i, i] > limit[i - first]:
            shrink = np.sqrt(limit[i - first] / P[i, i])
            for j in range(n):
                P[i, j] *= shrink
                P[j, i] *= shrink


@njit(cache=True)
def _filter(
    z, P, inputs, measured, kinds, A_q, additive, has_delta, nodes, Q, R, limit, gate, step, p
):  # pragma: no cover
    """The joint EKF. See `run_filter`."""
    n, size, n_q, n_map = len(inputs), len(z), A_q.shape[1], len(nodes)
    n_y, first_map = len(kinds), len(z) - len(nodes)
    states, variances = np.empty((n, size)), np.empty((n, size))
    residuals, rejected = np.empty((n, n_y)), np.zeros((n, n_y), np.bool_)
    transitions, gains, flows = np.empty((n, 3, 3)), np.empty((n, 3, n_y)), np.empty(n)
    bounds_low, bounds_high = np.array([6e4, 6e4, 300.0]), np.array([9e5, 1.2e6, 25e3])
    for k in range(n):
        gain_k = np.zeros((3, n_y))
        # measurement update, one scalar after another
        for m in range(n_y):
            h = np.zeros(size)
            if kinds[m] < 3:
                h[kinds[m]] = 1.0
                predicted = z[kinds[m]]
            else:
                delta = z[3 + n_q] if has_delta else 0.0
                flow = compressor_flow(z[0], z[2], p) + delta
                by_p = (compressor_flow(z[0] + 10.0, z[2], p) - compressor_flow(z[0] - 10.0, z[2], p)) / 20.0
                by_w = (compressor_flow(z[0], z[2] + 0.5, p) - compressor_flow(z[0], z[2] - 0.5, p)) / 1.0
                factor = 1.0
                predicted = flow
                if n_map > 0:
                    j = min(max(np.searchsorted(nodes, flow) - 1, 0), n_map - 2)
                    share = min(max((flow - nodes[j]) / (nodes[j + 1] - nodes[j]), 0.0), 1.0)
                    left, right = z[first_map + j], z[first_map + j + 1]
                    correction = (1.0 - share) * left + share * right
                    slope = (right - left) / (nodes[j + 1] - nodes[j]) if 0.0 < share < 1.0 else 0.0
                    predicted = (1.0 + correction) * flow
                    factor = 1.0 + correction + slope * flow
                    h[first_map + j], h[first_map + j + 1] = (1.0 - share) * flow, share * flow
                h[0], h[2] = factor * by_p, factor * by_w
                if has_delta:
                    h[3 + n_q] = factor
                if additive and n_q > 0:
                    predicted += z[3]
                    h[3] = 1.0
            Ph = P @ h
            S = h @ Ph + R[m]
            innovation = measured[k, m] - predicted
            if not np.isfinite(innovation) or innovation * innovation > gate * gate * S:
                rejected[k, m] = True
                continue
            K = Ph / S
            z = z + K * innovation
            # Joseph form: P stays symmetric and positive definite
            P = P - np.outer(K, Ph) - np.outer(Ph, K) + S * np.outer(K, K)
            # K_total of sequential updates: K = (I - k_m h_m') K + k_m e_m'
            hx = h[:3]
            for i in range(n_y):
                c = hx @ gain_k[:, i].copy()
                for r in range(3):
                    gain_k[r, i] -= K[r] * c
            for r in range(3):
                gain_k[r, m] += K[r]
        for i in range(3):
            z[i] = min(max(z[i], bounds_low[i]), bounds_high[i])
        states[k] = z
        for i in range(size):
            variances[k, i] = P[i, i]
        delta = z[3 + n_q] if has_delta else 0.0
        flows[k] = compressor_flow(z[0], z[2], p) + delta
        for m in range(n_y):
            residuals[k, m] = measured[k, m] - (z[kinds[m]] if kinds[m] < 3 else flows[k])
        # time update
        at = z[:3].copy()
        if not additive:
            at -= A_q @ z[3 : 3 + n_q]
        A = diesel_jacobian(at, delta, inputs[k], p)
        rates = diesel_rates(at[0], at[1], at[2], delta, inputs[k], p)
        F = np.eye(size)
        F[:3, :3] += step * A
        if not additive and n_q > 0:
            F[:3, 3 : 3 + n_q] = -step * (A @ A_q)
        if has_delta:
            F[0, 3 + n_q] = step * p.R_a * p.T_im / p.V_im
        transitions[k], gains[k] = F[:3, :3], gain_k
        for i in range(3):
            z[i] = min(max(z[i] + step * rates[i], bounds_low[i]), bounds_high[i])
        # only the first three rows of F differ from the identity
        top = F[:3] @ P
        P[:3, :] = top
        P[:, :3] = P @ F[:3].T
        for i in range(size):
            P[i, i] += Q[i]
            for j in range(i):
                P[i, j] = P[j, i] = 0.5 * (P[i, j] + P[j, i])
        limit_covariance(P, first_map, limit)
    return states, variances, residuals, rejected, transitions, gains, flows, P


@dataclass(frozen=True)
class DieselObserver:
    """How the filter is built: which sensors it uses, which biases and map it carries, and its tuning.

    Defaults: no augmentation (the seeds' "Def."). Standard deviations; `*_walk` per square root of a second.
    """

    sensors: tuple[int, ...] = (0, 2)
    """0 p_im, 1 p_em, 2 omega_t, 3 air flow: the columns of the measurements, in this order."""
    noise: tuple[float, ...] = (500.0, 20.0)
    """Of each sensor: Pa, Pa, rad/s, kg/s."""
    walk: tuple[float, float, float] = (4e3, 4e3, 60.0)
    """Process noise of the three states."""
    augmentation: NDArray[np.float64] = field(default_factory=lambda: np.zeros((3, 0)))
    """A_q, (3, n_q): q moves the stationary point by A_q q."""
    augmentation_walk: float = 5e3
    augmentation_start: float = 2e4
    additive: bool = False
    """One bias, added to the measured air flow instead (seed 002, "Aug.")."""
    compressor_error: bool = False
    """Carry Delta_W."""
    compressor_walk: float = 5e-3
    nodes: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    """Air flow (kg/s) at the nodes of the sensor's error map (seed 002, "Map.")."""
    node_walk: float = 5e-4
    node_start: float = 0.1
    """Standard deviation of a node at first, and the limit of its growth (seed 002, 3.1)."""
    gate: float = 1e9
    """Innovations beyond so many standard deviations are taken for outliers."""
    parameters: DieselParameters = field(default_factory=DieselParameters)


@dataclass(frozen=True)
class DieselEstimate:
    """What the filter found, arrays over time."""

    state: NDArray[np.float64]
    """(n, 3)."""
    bias: NDArray[np.float64]
    """(n, n_q), q (or the additive bias, kg/s)."""
    compressor_error: NDArray[np.float64]
    """(n,), kg/s; zero if not carried."""
    nodes: NDArray[np.float64]
    """(n, n_nodes), theta."""
    variance: NDArray[np.float64]
    """(n, all states), diagonal of P."""
    residual: NDArray[np.float64]
    """(n, sensors), y - h(x) after the update, without biases and map: eq. 8 of seed 001."""
    rejected: NDArray[np.bool_]
    transition: NDArray[np.float64]
    """(n, 3, 3), F = I + T_s A."""
    gain: NDArray[np.float64]
    """(n, 3, sensors), K of the three states."""
    air_flow: NDArray[np.float64]
    """(n,), kg/s, the model's."""
    covariance: NDArray[np.float64]
    """P at the end."""


def run_filter(
    observer: DieselObserver, inputs: NDArray, measured: NDArray, step: float, start: NDArray
) -> DieselEstimate:
    """Run the joint EKF over `inputs` (n, 4) and `measured` (n, sensors; NaN is no measurement), from `start` (3,)."""
    o = observer
    n_q = 1 if o.additive else o.augmentation.shape[1]
    n_map = len(o.nodes)
    A_q = np.zeros((3, n_q)) if o.additive else np.ascontiguousarray(o.augmentation, dtype=float)
    delta = [o.compressor_walk] if o.compressor_error else []
    walk = np.concatenate([o.walk, np.full(n_q, o.augmentation_walk), delta, np.full(n_map, o.node_walk)])
    spread = np.concatenate(
        [0.05 * SCALE, np.full(n_q, o.augmentation_start), [0.02] if delta else [], np.full(n_map, o.node_start)]
    )
    z = np.concatenate([start, np.zeros(len(walk) - 3)])
    out = _filter(
        z,
        np.diag(spread**2),
        np.ascontiguousarray(inputs, dtype=float),
        np.ascontiguousarray(measured, dtype=float),
        np.array(o.sensors, dtype=np.int64),
        A_q,
        o.additive,
        o.compressor_error,
        np.ascontiguousarray(o.nodes, dtype=float),
        walk**2 * step,
        np.array(o.noise, dtype=float) ** 2,
        np.full(n_map, o.node_start**2),
        o.gate,
        step,
        o.parameters,
    )
    states, variances, residuals, rejected, transitions, gains, flows, P = out
    last = 3 + n_q + len(delta)
    error = states[:, 3 + n_q] if o.compressor_error else np.zeros(len(states))
    return DieselEstimate(
        states[:, :3], states[:, 3 : 3 + n_q], error, states[:, last:], variances, residuals, rejected, transitions,
        gains, flows, P,
    )  # fmt: skip
