"""The observer on a truth of the tests' own: accuracy, robustness, and stream against batch."""

import logging
from dataclasses import replace

import numpy as np
import pytest
from synthetic import SMART, Truth, drive, sense

from observer import kernel, model
from observer.estimate import STATES, Estimate
from observer.events import prepare
from observer.fixed_lag import observe_lagged
from observer.observe import observe, start, without_spikes
from observer.settings import DEFAULT
from observer.stream import Observer
from sensors.log import SensorLog

START = 3.0
"""s: the logger's clock at the truth's time 0 (as `sense` sets it)."""


@pytest.fixture(scope="module")
def truth() -> Truth:
    return drive(seed=1, duration=240.0)


@pytest.fixture(scope="module")
def log(truth: Truth) -> SensorLog:
    return sense(truth, seed=1)


@pytest.fixture(scope="module")
def estimate(log: SensorLog) -> Estimate:
    return observe(log, SMART)


def thrust_error(estimate: Estimate, truth: Truth, *, smoothed: bool = False, after: float = 30.0) -> float:
    """Root mean square error as a share of the thrust's rms, while the engine drives."""
    at = np.clip(np.round((estimate.time - START) / 0.01).astype(int), 0, len(truth.time) - 1)
    use = truth.driving[at] & (estimate.time > START + after)
    error = estimate.column("thrust", smoothed=smoothed)[use] - truth.thrust[at][use]
    return float(np.sqrt(np.mean(error**2) / np.mean(truth.thrust[at][use] ** 2)))


def changed(log: SensorLog, **streams: np.ndarray) -> SensorLog:
    return SensorLog({**log.streams, **streams})


def test_thrust_is_found_live_and_better_in_hindsight(estimate, truth):
    assert thrust_error(estimate, truth) < 0.08
    assert thrust_error(estimate, truth, smoothed=True) < 0.035


def test_stated_uncertainty_is_that_seen(estimate, truth):
    at = np.clip(np.round((estimate.time - START) / 0.01).astype(int), 0, len(truth.time) - 1)
    use = truth.driving[at] & (estimate.time > START + 30.0)
    for name, true in (("thrust", truth.thrust), ("speed", truth.speed), ("pitch", truth.pitch)):
        error = (estimate.column(name) - true[at])[use]
        assert np.mean(error**2 / estimate.variance[use, STATES.index(name)]) < 6.0, name


def test_every_measurement_leaves_a_record(estimate, log):
    kinds = {str(kind) for kind in np.unique(estimate.records["kind"])}
    assert {"acceleration_x", "distance", "injected_energy", "engine_angle", "gps_north", "gps_speed"} <= kinds
    for kind, stream in (("acceleration_z", "accelerometer"), ("gps_east", "gps"), ("distance", "wheel")):
        assert np.count_nonzero(estimate.records["kind"] == kind) == pytest.approx(len(log[stream]), abs=6)
    fused = estimate.records[estimate.records["fused"]]
    np.testing.assert_allclose(fused["nis"][:1000], (fused["innovation"] ** 2 / fused["variance"])[:1000])


def test_stream_gives_the_bits_of_the_batch(log, estimate):
    observer = Observer(SMART)
    streams = [
        (row["order"], name, packets[i : i + 1])
        for name, packets in log.streams.items()
        for i, row in enumerate(packets)
    ]
    streams.sort(key=lambda item: item[0])
    updates = [observer.update(name, packet) for _, name, packet in streams[:30_000]]
    time = np.concatenate([update.time for update in updates])
    state = np.concatenate([update.state for update in updates])
    assert len(time) > 1000
    np.testing.assert_array_equal(time, estimate.time[: len(time)])
    np.testing.assert_array_equal(state, estimate.state[: len(time)])
    records = np.concatenate([update.records for update in updates])
    np.testing.assert_array_equal(records["innovation"], estimate.records["innovation"][: len(records)])


def test_a_jump_of_the_receiver_is_refused_and_the_gate_opens_again(log, truth):
    gps = log["gps"].copy()
    wrong = (gps["t"] > 100.0) & (gps["t"] < 112.0)
    gps["latitude"][wrong] += 0.0045  # 500 m
    found = observe(changed(log, gps=gps), SMART)
    rows = found.records[(found.records["kind"] == "gps_north")]
    during = rows[(rows["t"] > 100.2) & (rows["t"] < 102.5)]
    assert not during["fused"].any()
    assert (during["reason"] == "gate").all()
    after = rows[(rows["t"] > 135.0) & (rows["t"] < 200.0)]
    assert after["fused"].mean() > 0.95
    assert thrust_error(found, truth) < 0.10


@pytest.mark.parametrize("stream", ["gps", "accelerometer", "wheel", "injector"])
def test_a_lost_sensor_costs_accuracy_not_sanity(log, stream):
    found = observe(changed(log, **{stream: log[stream][:0]}), SMART)
    assert np.isfinite(found.state).all()
    assert np.isfinite(found.smoothed).all()
    assert (found.variance > 0.0).all()
    assert np.abs(found.column("pitch")).max() < 0.5
    if stream == "gps":
        return
    assert np.isnan(found.origin).sum() == 0


def test_lost_and_doubled_pulses_offset_nothing(log, truth, estimate):
    rng = np.random.default_rng(5)
    wheel, injector = log["wheel"], log["injector"]
    wheel = wheel[rng.random(len(wheel)) > 0.005]
    twice = np.sort(np.concatenate([np.arange(len(injector)), rng.integers(0, len(injector), 30)]))
    found = observe(changed(log, wheel=wheel, injector=injector[twice]), SMART)
    assert thrust_error(found, truth) < 1.5 * thrust_error(estimate, truth)
    at = np.clip(np.round((found.time - START) / 0.01).astype(int), 0, len(truth.time) - 1)
    late = found.time > found.time[-1] - 60.0
    assert np.sqrt(np.mean((found.column("speed") - truth.speed[at])[late] ** 2)) < 0.15


def test_garbage_never_enters(log):
    """NaN, infinities, absurd and backward stamps: the estimate is that of the log without them."""
    rng = np.random.default_rng(7)
    acc = log["accelerometer"].copy()
    bad = rng.choice(np.arange(1000, len(acc) - 1000), 40, replace=False)
    clean = observe(changed(log, accelerometer=np.delete(acc, bad)), SMART)
    acc["t"][bad[:10]], acc["t"][bad[10:20]], acc["t"][bad[20:30]] = np.nan, 1e9, -5.0
    acc["x"][bad[30:35]], acc["x"][bad[35:]] = np.nan, np.inf
    acc["y"][bad[30:]] = acc["z"][bad[30:]] = np.nan
    found = observe(changed(log, accelerometer=acc), SMART)
    # a reading without sense still splits a step of the integration in two
    for name, tolerance in (("thrust", 2.0), ("speed", 2e-3), ("pitch", 1e-4), ("north", 1e-2), ("bias_x", 1e-4)):
        np.testing.assert_allclose(found.column(name), clean.column(name), rtol=0, atol=tolerance, err_msg=name)
    assert np.count_nonzero(found.records["reason"] == "not_finite") >= 10


def test_a_broken_covariance_is_reset_and_told(log, caplog):
    """Given a noise that takes certainty for granted until the variance turns negative, then every reset is logged."""
    with caplog.at_level(logging.WARNING, logger="observer"):
        found = observe(log, SMART, settings=replace(DEFAULT, bias_noise=-1e-3))
    assert "covariance not positive" in caplog.text
    assert np.isfinite(found.state).all()
    caplog.clear()
    with caplog.at_level(logging.WARNING, logger="observer"):
        observe(log, SMART)
    assert not caplog.records


def test_no_packet_at_all_is_an_empty_estimate():
    empty = observe(SensorLog({}), SMART)
    assert len(empty.time) == 0
    assert empty.state.shape == (0, 17)


def test_the_clock_may_be_set_anew(log):
    """Given a logger that restarts its clock at 120 s, then the estimate goes on."""
    streams = {name: packets.copy() for name, packets in log.streams.items()}
    for packets in streams.values():
        packets["t"][packets["t"] > 120.0] -= 118.0
    found = observe(SensorLog(streams), SMART)
    assert np.isfinite(found.state).all()
    assert found.time[-1] == pytest.approx(log["accelerometer"]["t"][-1], abs=3.0)


def test_one_early_fix_does_not_make_all_others_late(log, estimate):
    """Given a fix stamped 2 s too early, then the receiver's lag is right again within ten seconds."""
    gps = log["gps"].copy()
    wrong = int(np.searchsorted(gps["t"], 100.0))
    gps["utc"][wrong] += 2.0
    found = observe(changed(log, gps=gps), SMART)
    late = found.time > 115.0
    np.testing.assert_allclose(found.column("speed")[late], estimate.column("speed")[late], rtol=0, atol=0.02)


def test_biases_are_carried_over(truth, log, estimate):
    """Without GPS, knowing the biases from an earlier trip helps."""
    deaf = changed(log, gps=log["gps"][:0])
    known, unknown = observe(deaf, SMART, learnt=estimate.learnt), observe(deaf, SMART)
    assert thrust_error(known, truth) < 0.09
    assert thrust_error(known, truth, smoothed=True) < thrust_error(unknown, truth, smoothed=True)


def test_standstill_keeps_what_cannot_be_seen():
    """Parked for two minutes: pitch and position stay, nothing diverges."""
    truth = drive(seed=1, duration=120.0)
    parked = {field: getattr(truth, field) for field in truth.__dataclass_fields__}
    n = 12_000
    for name, values in parked.items():
        tail = np.repeat(values[-1], n)
        if name == "time":
            tail = values[-1] + 0.01 * np.arange(1, n + 1)
        elif name in ("speed", "acceleration", "thrust", "straightness", "vertical_straightness"):
            tail = np.zeros(n)
        elif name == "driving":
            tail = np.zeros(n, bool)
        elif name in ("engine_angle", "fuel_energy"):
            rate = 90.0 if name == "engine_angle" else 2.5e3
            tail = values[-1] + rate * 0.01 * np.arange(1, n + 1)
        parked[name] = np.concatenate([values, tail])
    found = observe(sense(replace(truth, **parked), seed=3), SMART)
    still = found.time > START + 180.0
    assert np.abs(found.column("speed")[still]).max() < 0.3
    assert np.ptp(found.column("pitch")[still]) < 0.01
    assert np.ptp(found.column("north")[still]) < 10.0


def test_a_fixed_lag_lies_between_live_and_hindsight(log, truth, estimate):
    """One second's wait takes most of what the whole trip's hindsight takes; with a long lag it is that hindsight."""
    short = SensorLog({name: packets[packets["t"] < 75.0] for name, packets in log.streams.items()})
    whole = observe(short, SMART)
    time, state, variance = observe_lagged(short, SMART, 1.0)
    np.testing.assert_array_equal(time, whole.time)
    lagged = replace(whole, smoothed=state, smoothed_variance=variance)
    live, waited, final = (
        thrust_error(whole, truth),
        thrust_error(lagged, truth, smoothed=True),
        thrust_error(whole, truth, smoothed=True),
    )
    assert waited < 0.8 * live
    assert final < 1.1 * waited
    _, state, _ = observe_lagged(short, SMART, 100.0)
    np.testing.assert_allclose(state, whole.smoothed, rtol=1e-6, atol=1e-6)
    with pytest.raises(ValueError, match="lag"):
        observe_lagged(short, SMART, 0.1)


def test_an_accelerometer_noisier_than_believed_is_believed_less(log, truth):
    """Given five times the usual noise, then thrust stays usable, live and in hindsight, and the NIS is about 1."""
    rng = np.random.default_rng(11)
    acc = log["accelerometer"].copy()
    for axis, deviation in (("x", 0.6), ("y", 0.6), ("z", 2.0)):
        acc[axis] += deviation * rng.standard_normal(len(acc))
    found = observe(changed(log, accelerometer=acc), SMART)
    assert thrust_error(found, truth) < 0.25
    assert thrust_error(found, truth, smoothed=True) < 0.12
    mine = found.records[(found.records["kind"] == "acceleration_x") & (found.records["t"] > START + 30.0)]
    assert 0.7 < mine["nis"].mean() < 1.5


def test_a_step_of_speed_is_seen_as_the_receivers_own_filter_sees_it():
    """A receiver that smooths over 0.2 s tells of a jolt late: its speed is no surprise then."""
    f = start(SMART, DEFAULT, None, 0.0)
    f.counts[kernel.RECORDING] = 1
    f = f._replace(records=np.empty((100, 7)))
    f.x[[kernel.V, 2]] = 10.0, 2500.0
    f.P[:] = np.diag(np.full(kernel.NX, 1e-8))
    f.memory[[kernel.M_TOLD_SPEED, kernel.M_CLOCK_SET, kernel.M_HEADING_SET, kernel.M_ORIGIN_SET]] = 10.0, 1.0, 1.0, 1.0
    f.memory[kernel.M_CLOCK] = 1.0
    f.memory[[kernel.M_NORTH_SCALE, kernel.M_EAST_SCALE]] = 1.0
    rows, told, speed = [], 10.0, 10.0
    for step in range(1, 41):
        # thrust has just set in: the car gains what it gains, the receiver follows with its time constant
        rows.append([0.01 * step, kernel.GYROSCOPE, np.nan, np.nan, np.nan, 0, 0, 0, 0, 0])
    events = np.array(rows)
    worst = 0.0
    for row in events:
        kernel.advance(row[None], 0, 1, f)
        speed = f.x[kernel.V]
        told += (speed - told) * (1.0 - np.exp(-0.01 / DEFAULT.gps_lag))
        worst = max(worst, abs(f.memory[kernel.M_TOLD_SPEED] - told))
    assert speed > 10.5
    assert speed - told > 0.15
    assert worst < 1e-9


@pytest.mark.parametrize("hindsight", [0.0, 1.0])
def test_brakes_that_are_released_are_gone_at_once(hindsight):
    """Braking hard, then the forward acceleration jumps by 1.9 m/s2: thrust follows within 0.1 s."""
    f = start(SMART, DEFAULT, None, 0.0)
    f.x[[kernel.V, 2]] = 12.0, -1700.0
    f.P[:] = np.diag([1e-6, 1e-4, 30.0**2, *[1e-8] * (kernel.NX - 3)])
    f.memory[kernel.M_HINDSIGHT] = hindsight
    f.memory[[kernel.M_TICK_TIME, kernel.M_PULSE_TIME]] = 0.0
    f.memory[kernel.M_PULSE_GAP] = 0.2

    def reading(time: float, forward: float) -> None:
        event = np.array([[time, kernel.ACCELEROMETER, forward, 0.01 * np.sin(1e3 * time), 9.8, 0, 0, 0, 0, 0]])
        kernel.advance(event, 0, 1, f)

    before = acceleration_of(f)
    reading(0.025, before + 15.0)
    assert f.x[2] == pytest.approx(-1700.0, abs=120.0)
    for k in range(2, 6):
        reading(0.025 * k, before + 1.9)
    assert f.x[2] == pytest.approx(-1700.0 + 1.9 * SMART.accelerated_mass, abs=200.0)


def acceleration_of(f: kernel.Filter) -> float:
    """What the accelerometer reads in the state of `f`."""
    return model.measurement(model.ACCELERATION_X, f.x[:17], SMART, 0.0, squat=DEFAULT.body_squat)


def test_a_pulse_told_twice_counts_once(log, estimate):
    rng = np.random.default_rng(6)
    injector = log["injector"]
    twice = np.sort(np.concatenate([np.arange(len(injector)), rng.integers(0, len(injector), 300)]))
    found = observe(changed(log, injector=injector[twice]), SMART)
    np.testing.assert_array_equal(found.state, estimate.state)
    np.testing.assert_array_equal(found.smoothed, estimate.smoothed)
    assert np.count_nonzero(found.records["reason"] == "stuck") == 300


def test_noise_is_no_spike(log):
    """Given an accelerometer of 1 m/s2 of noise over half the drive, hardly an honest reading is taken for a spike."""
    acc = log["accelerometer"].copy()
    half = len(acc) // 2
    acc["x"][half:] += np.random.default_rng(3).normal(0.0, 1.0, len(acc) - half)
    packets, _ = prepare(changed(log, accelerometer=acc))
    clean = without_spikes(packets, np.array([1.0, 0.0, 0.0]))
    assert np.isnan(clean[:, 2]).sum() - np.isnan(packets[:, 2]).sum() < 1e-3 * len(acc)


def test_two_spikes_in_a_row_are_two_spikes(log):
    """Given two absurd readings in a row, not alike, then both are left out, and nothing of what is around them."""
    acc = log["accelerometer"].copy()
    acc["x"][500], acc["x"][501] = acc["x"][499] + 12.0, acc["x"][499] + 6.0
    packets, _ = prepare(changed(log, accelerometer=acc))
    clean = without_spikes(packets, np.array([1.0, 0.0, 0.0]))
    left_out = np.flatnonzero(np.isnan(clean[:, 2]) & np.isfinite(packets[:, 2]))
    np.testing.assert_array_equal(packets[left_out, 2], acc["x"][500:502])


def test_a_spike_across_the_car_is_a_spike(log):
    """Given one reading that is absurd upwards and harmless forwards, then all of it is left out."""
    acc = log["accelerometer"].copy()
    acc["z"][500] -= 15.0
    packets, _ = prepare(changed(log, accelerometer=acc))
    clean = without_spikes(packets, np.array([1.0, 0.0, 0.0]))
    left_out = np.flatnonzero(np.isnan(clean[:, 2]) & np.isfinite(packets[:, 2]))
    np.testing.assert_array_equal(packets[left_out, 4], acc["z"][500:501])


def test_spikes_of_the_accelerometer_are_no_brakes(log, truth, estimate):
    """Given 2 % of readings at random within 2 g, then thrust is hardly worse, live and in hindsight."""
    rng = np.random.default_rng(12)
    acc = log["accelerometer"].copy()
    hit = rng.random(len(acc)) < 0.02
    for axis in "xyz":
        acc[axis][hit] = rng.uniform(-20.0, 20.0, int(hit.sum()))
    found = observe(changed(log, accelerometer=acc), SMART)
    for smoothed in (False, True):
        usual = thrust_error(estimate, truth, smoothed=smoothed)
        assert thrust_error(found, truth, smoothed=smoothed) < 1.5 * usual + 0.02
