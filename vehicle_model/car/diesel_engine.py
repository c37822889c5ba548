"""Declared parameters of the benchmark engine: a six-cylinder truck diesel with variable-geometry turbine and EGR.

Values: the public parameter file TCDI_EGR_VGT of J. Wahlström and L. Eriksson, "Modelling diesel engines with a
variable-geometry turbocharger and exhaust gas recirculation by optimization of model parameters for capturing
non-linear system dynamics", Proc. IMechE Part D 225(7), 2011, doi 10.1177/0954407011398177. The symbols are the
paper's; SI units, but valve positions in percent, engine speed in rpm and injected fuel in mg per cycle.
"""

from typing import NamedTuple


class DieselParameters(NamedTuple):
    """All floats, so that compiled code takes it as it is. Order and names follow the paper's subsystems."""

    # gases and surroundings
    c_pa: float = 1011.0  # [J/(kg K)]
    c_pe: float = 1332.0  # [J/(kg K)]
    c_va: float = 724.0  # [J/(kg K)]
    R_a: float = 287.0  # [J/(kg K)]
    R_e: float = 286.0  # [J/(kg K)]
    gamma_a: float = 1.3964088397790055
    gamma_e: float = 1.2734225621414914
    gamma_cyl: float = 1.35  # gamma_c of the file: gas in the cylinder
    T_amb: float = 298.4636219512196  # [K]
    p_amb: float = 101111.34146341463  # [Pa]
    # manifolds
    V_im: float = 0.022  # [m3]
    T_im: float = 300.6185731707316  # [K]
    V_em: float = 0.02  # [m3]
    # cylinders
    r_c: float = 17.0
    V_d: float = 0.01274  # [m3]
    n_cyl: float = 6.0
    q_HV: float = 42.9e6  # [J/kg]
    c_vol1: float = -0.00020816619843224996  # volumetric efficiency: times sqrt(p_im)
    c_vol2: float = -0.0034465158052700592  # times sqrt(n_e)
    c_vol3: float = 1.1497021021059144
    eta_sc: float = 1.1015294624801442  # Seliger cycle: non-ideal exhaust temperature
    x_cv: float = 2.3370584441920436e-14  # share of the fuel burnt at constant volume
    eta_igch: float = 0.6893563004149508
    c_fric1: float = 0.9727227568984633  # friction [bar] over n_e/1000 squared
    c_fric2: float = -0.6768830302567218
    c_fric3: float = 0.5981891259721203
    # exhaust pipes: heat loss
    h_tot: float = 96.27545984019156  # [W/(m2 K)]
    d_pipe: float = 0.1  # [m]
    l_pipe: float = 1.0  # [m]
    n_pipe: float = 2.0
    # EGR valve
    A_egrmax: float = 0.0004  # [m2]
    PI_egropt: float = 0.6500040483261396
    c_egr1: float = -0.00011104237992346043
    c_egr2: float = 0.01778061228607777
    c_egr3: float = 0.0
    tau_egr1: float = 0.05  # [s]
    tau_egr2: float = 0.13  # [s]
    tau_degr: float = 0.065  # [s], dead time
    K_egr: float = 1.8
    # turbine
    A_vgtmax: float = 0.0008455767262643882  # [m2]
    R_t: float = 0.04  # [m]
    K_t: float = 2.89019266110711
    c_f1: float = 1.9479627004385558
    c_f2: float = -0.7763118932867504
    c_vgt1: float = 126.87193572285548  # [%]
    c_vgt2: float = 117.14474688230767  # [%]
    eta_tmmax: float = 0.818002726891074
    BSR_opt: float = 0.9755203161802092
    c_m1: float = 1.3563440681098633
    c_m2: float = 2769.2092015766916  # [rad/s]
    c_m3: float = 0.010000098744565608
    w_tlin: float = 2796.9012935924584  # [rad/s], below it c_m is linear
    c_mlin: float = 1.4021470818125312
    tau_vgt: float = 0.025  # [s]
    tau_dvgt: float = 0.04  # [s], dead time
    J_t: float = 0.0002  # [kg m2]
    # compressor
    R_c: float = 0.04  # [m]
    c_wpsi1: float = 1.0882051052898697e-08
    c_wpsi2: float = -0.00017319760359675625
    c_wpsi3: float = 1.0286164756408622
    c_wphi1: float = -1.4297782685109732e-08
    c_wphi2: float = -0.0015498814145503597
    c_wphi3: float = 29.646172151290827
    eta_cmax: float = 0.7363607879724583
    w_copt: float = 0.27533757461959213  # [kg/s]
    pi_copt: float = 1.045517746825637
    c_pi: float = 0.2707594738764899
    Q_c11: float = 3.091897768531849
    Q_c12: float = -2.4823201383170015
    Q_c22: float = 2.1478559620438133
