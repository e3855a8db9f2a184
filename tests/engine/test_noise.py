"""Scenes with noise, against plain Python, closed forms, and each other."""

import math

import numpy as np
import pytest

import vibrosweep as vs
from tests.cases import each_of
from tests.general import BATCH_OF, everything_plain
from tests.scenes import STILL
from vibrosweep.engine import landings
from vibrosweep.kernels.bases import high_bounce
from vibrosweep.kernels.noise import OF_DRIVE, OF_KICK, OF_RESTITUTION, deviate, key_of

ALL = {"restitution_noise": 0.05, "kick_noise": 0.1, "drive_noise": 0.4}
SCENE = {"restitution": (0.5, 0.95), "amplitude": (0.0, 2.0), "realizations": 60, "particles": 2}
# speeds in units of g / (2 f), at which a flight lasts one forcing period
UNITS = {"gravity": 2.0, "frequency": 1.0, "phase": 0.0}


def plain(e, a, r, u, law, noise, *, stream, particle, start, end):
    """Landing times, in periods, of the map by its definition, one impact at a time."""
    key, sigma = key_of(5), {name.partition("_")[0]: value for name, value in noise.items()}

    def xi(kind, purpose, who, number):
        return sigma.get(kind, 0.0) * deviate(key, stream, who, number, purpose)

    def kick(t):
        strength = a * (1.0 + xi("drive", OF_DRIVE, 0.0, float(math.floor(t))))
        return strength, strength * math.sin(2.0 * math.pi * t)

    t, found = start, []
    while t + u <= end:
        t += u
        found.append(t)
        restitution = min(
            max(e + xi("restitution", OF_RESTITUTION, particle, len(found) - 1), 0), 1
        )
        push = (1.0 + e) * xi("kick", OF_KICK, particle, len(found) - 1)
        w = restitution * u + kick(t)[1] + push
        u = abs(w) if law == "reflect" else w
        if u > r:
            continue
        u = r
        while t <= end:
            strength, lift = kick(t)
            if lift > r:
                break
            late, period = t - math.floor(t), math.floor(t)
            rises = math.asin(r / abs(strength)) / (2 * math.pi) if abs(strength) > r else math.inf
            rises += 0.5 if strength < 0 else 0.0
            if late < rises < 1.0:
                t = period + rises * (1.0 + 1e-14)
                break
            t = period + 1.0
    return found


@pytest.mark.parametrize(
    ("law", "phase"),
    [
        ("rest", 0.0),
        ("rest", 3.2),
        ("rest", -20.0),
        ("reflect", 0.0),
        pytest.param("reflect", -20.0, marks=pytest.mark.weekly),
    ],
)
def test_landings_are_those_of_the_definition(law, phase):
    """Periods are counted from the whole phase, which may be many turns."""
    e, a, u0, r = 0.7, 0.45, 1.3, 0.02
    scene = {**UNITS, "restitution": e, "amplitude": a, "launch_velocity": u0, "contact_time": r}
    starts, end = [0.0, 0.31], 12.0
    found = vs.simulate(
        **scene | {"phase": phase}, **ALL, rebound=law, launch_time=starts, duration=end,
        noise_seed=5, noise_stream=[0, 77],
    )  # fmt: skip
    turns = phase / (2.0 * math.pi)
    for i, stream in enumerate((0.0, 77.0)):
        for particle, start in enumerate(starts):
            place = {"stream": stream, "particle": float(particle), "start": start + turns}
            known = plain(e, a, r, u0, law, ALL, **place, end=end + turns)
            landed = found.landing_time.values[i, particle]
            landed = landed[~np.isnan(landed)]
            # the sum of start and turns is rounded, and the motion amplifies that
            few = min(len(known), 25 if phase == 0.0 else 15)
            assert few > 4
            assert landed.size == len(known) or len(known) > few
            assert landed[:few] + turns == pytest.approx(known[:few], abs=1e-8)


def test_whole_turns_of_the_phase_are_periods_that_have_passed():
    """A launch m periods later has the same motion as a phase of m turns more, in all measures."""
    scene = {**ALL, "contact_time": 0.06, "restitution": 0.4, "amplitude": [0.3, 1.2]}
    scene |= {"noise_seed": 5, "separation": True, "per_particle": True}
    turned = vs.simulate(**scene, phase=3.0 + 8.0 * math.pi, launch_time=[0.0, 0.3], duration=9.0)
    later = vs.simulate(**scene, phase=3.0, launch_time=[4.0, 4.3], duration=13.0)
    assert np.array_equal(turned.impact_count, later.impact_count)
    assert int(turned.rested.sum()) > 0
    few = turned.landing_time.values[..., :20], later.landing_time.values[..., :20] - 4.0
    np.testing.assert_allclose(*few, rtol=0.0, atol=1e-9)
    assert np.array_equal(turned.collision_free, later.collision_free)
    np.testing.assert_allclose(turned.dt_min, later.dt_min, rtol=0.0, atol=1e-9)


def test_a_realization_of_a_sweep_is_replayed_landing_by_landing():
    asked = {**SCENE, **ALL, "noise_seed": 3, "duration": 20.0, "seed": 1}
    sweep = vs.sweep(**asked, separation=True, per_particle=True)
    assert sweep.noise_seed == 3
    assert (sweep.noise_stream == np.arange(60)).all()
    record = vs.simulate(sweep.isel(realization=slice(7, 40)))
    of_each = sweep.isel(realization=slice(7, 40))
    assert (record.impact_count == of_each.particle_impact_count).all()
    assert (record.rested.sum("impact") == of_each.particle_rest_count).all()
    fastest = (record.rebound_velocity.max("impact") ** 2 / (2 * 9.81)).values
    assert fastest == pytest.approx(of_each.particle_rebound_height_max.values, rel=1e-13)
    for realization in range(33):
        times = record.landing_time.values[realization]
        apart = np.abs(times[0][:, np.newaxis] - times[1])
        assert np.nanmin(apart) == pytest.approx(of_each.dt_min.values[realization], abs=1e-13)


def test_noise_depends_on_seed_stream_particle_and_impact_only():
    asked = {**SCENE, **ALL, "duration": 15.0, "seed": 1, "separation": True}
    one = vs.sweep(**asked, threads=1)
    assert vs.sweep(**asked, threads=2).equals(one)
    alone = vs.simulate(one.isel(realization=31))
    assert alone.impact_count.sum() == one.impact_count[31]
    other = vs.sweep(**asked, noise_seed=1)
    assert (other.impact_count != one.impact_count).any()
    axis = {"restitution": 0.9, "amplitude": [0.5], "particles": 1, "duration": 15.0}
    two = vs.sweep(**axis | {name: [value, 2.0 * value] for name, value in ALL.items()})
    assert two.noise_stream.values.ravel().tolist() == list(range(two.noise_stream.size))


def test_lift_offs_from_a_moving_base_are_those_of_the_definition():
    """The relative speed is |e_n v + (1 + e) sigma_V xi|, and sweeps count the same landings."""
    asked = {"base": "moving", "restitution_noise": 0.1, "kick_noise": 0.1, "noise_seed": 5}
    asked |= {"particles": 2, "duration": 25.0}
    sweep = vs.sweep(**asked, restitution=0.8, base_acceleration=(0.5, 3.0), realizations=20)
    record = vs.simulate(sweep)
    assert (record.impact_count.sum("particle") == sweep.impact_count).all()
    key, seen = key_of(5), 0
    for i, velocity in enumerate(record.amplitude.values / 1.8):
        flights = (record[n].values[i, 1] for n in ("liftoff_time", "rebound_velocity"))
        left, speed = (np.r_[first, v] for first, v in zip((0.5, 5.0), flights, strict=True))
        for k in range(int(record.impact_count[i, 1])):
            landing = record.landing_time.values[i, 1, k]
            base = velocity * math.sin(2.0 * math.pi * landing)
            arrival = base - (speed[k] - 9.81 * (landing - left[k]))
            e = 0.8 + 0.1 * deviate(key, float(i), 1.0, float(k), OF_RESTITUTION)
            push = 0.18 * deviate(key, float(i), 1.0, float(k), OF_KICK)
            if record.rested.values[i, 1, k] == 0:
                known = abs(min(max(e, 0.0), 1.0) * arrival + push)
                assert speed[k + 1] - base == pytest.approx(known, abs=1e-11)
                seen += 1
    assert seen > 100


def test_exponents_along_the_path():
    """About a locked orbit they are those of its multipliers; here their sum is 2 ln e."""
    scene = {"restitution": 0.9, "amplitude": 1.2, "duration": 400.0}
    scene |= {"launch_velocity": 4.905, "launch": [0.4329824], "base": "moving", "lyapunov": True}
    noise = {"kick_noise": 1e-3, "restitution_noise": 1e-4}
    still, found = (vs.sweep(**scene, **more) for more in ({}, noise))
    assert found.regime.item() == -1
    assert "never repeats" in found.notes
    assert found.cycle_periods.item() == 0
    assert found.unsettled_count == 0
    for name in ("lyapunov_largest", "lyapunov_sum"):
        assert found[name].item() == pytest.approx(still[name].item(), abs=2e-3)
    assert found.lyapunov_sum.item() == pytest.approx(2.0 * math.log(0.9), abs=1e-4)


def test_noise_of_strength_zero_is_no_noise():
    still = vs.sweep(amplitude=(0.2, 3.5), realizations=20, regimes=True, kick_noise=0.0)
    assert "noise_seed" not in still.attrs
    assert "kick_noise" not in still
    without = vs.sweep(amplitude=(0.2, 3.5), realizations=20, regimes=True)
    assert (still.regime == without.regime).all()


def test_particles_share_the_noise_of_the_drive_alone():
    scene = {**UNITS, "amplitude": 0.4, "launch_velocity": 1.0, "launch_time": [0.2, 0.2]}
    drive = vs.simulate(**scene, **STILL | {"drive_noise": 0.2}, duration=50.0)
    first, second = drive.landing_time.values[0]
    assert np.array_equal(first, second, equal_nan=True)
    kick = vs.simulate(**scene, **STILL | {"kick_noise": 0.02}, duration=50.0)
    assert (kick.landing_time[0, 0, 1:10] != kick.landing_time[0, 1, 1:10]).all()


def test_one_kind_of_noise_follows_the_definition(monkeypatch):
    """Other tests compute all kinds, some of strength 0 (`tests/general.py`); users do not."""
    everything_plain(monkeypatch)
    monkeypatch.setattr(landings, "batch_of", BATCH_OF)
    noise, end = {"kick_noise": 0.1}, 12.0
    scene = {**UNITS, "restitution": 0.7, "amplitude": 0.45, "launch_velocity": 1.3}
    found = vs.simulate(
        **scene, **noise, contact_time=0.02, launch_time=[0.0, 0.31], duration=end,
        noise_seed=5, noise_stream=[0, 77],
    )  # fmt: skip
    assert found.rested.sum() > 3
    for i, stream in enumerate((0.0, 77.0)):
        for particle, start in enumerate((0.0, 0.31)):
            place = {"stream": stream, "particle": float(particle), "start": start, "end": end}
            known = plain(0.7, 0.45, 0.02, 1.3, "rest", noise, **place)
            landed = found.landing_time.values[i, particle]
            # errors of 1e-16, amplified by the motion
            assert landed[~np.isnan(landed)] == pytest.approx(known, abs=1e-10)


def test_a_rest_without_end_is_abandoned(monkeypatch):
    """A deviate above 8.4 would lift the particle of the first sweep; none exceeds 8.4908."""
    everything_plain(monkeypatch)
    monkeypatch.setattr(high_bounce, "LONGEST", 300)
    scene = {**UNITS, **STILL, "restitution": 0.0, "contact_time": 0.1, "drive_noise": 1.0}
    found = vs.sweep(**scene, amplitude=0.1 / 9.4, launch_velocity=1.0, duration_periods=1e12)
    assert vs.Status(found.status.item()) == vs.Status.BUDGET_EXCEEDED
    never = vs.sweep(**scene, amplitude=0.1 / 9.5, launch_velocity=1.0, duration_periods=1e12)
    assert never.at_rest_count == 1


def test_the_stationary_energy_of_a_base_that_only_trembles():
    """<u^2> = sigma^2 / (1 - e^2 - sigma_e^2), from the means of 400 particles."""
    e, sigma_e, sigma = np.array([0.9, 0.8]), np.array([0.0, 0.05]), 1.0
    found = vs.simulate(
        **UNITS, restitution=e, restitution_noise=sigma_e, kick_noise=sigma / (1.0 + e),
        base="moving", amplitude=0.0, contact_time=1e-30, launch_velocity=2.0,
        launch=[0.0] * 400, duration=800.0,
    )  # fmt: skip
    u = found.rebound_velocity.values[:, :, 20:300]
    assert not np.isnan(u).any()
    means = (u**2).mean(axis=2)
    known = sigma**2 / (1.0 - e**2 - sigma_e**2)
    assert known == pytest.approx([5.263, 2.797], abs=1e-3)
    assert (abs(means.mean(axis=1) - known) < 3.5 * means.std(axis=1) / 20.0).all()


def test_particles_still_bouncing_after_n_impacts():
    """C(2n, n) / 4^n of them (Sparre Andersen), if kicks are purely random and e = 1."""
    found = vs.simulate(
        **UNITS, **STILL | {"kick_noise": 0.5}, restitution=1.0, amplitude=0.0, contact_time=1e-30,
        launch_velocity=1e-20, launch=[0.0] * 20000, duration=1e9, impact_budget=12,
    )  # fmt: skip
    rested = found.rested.values[0]
    for n in range(1, 7):
        share, known = (rested[:, :n].max(axis=1) == 0).mean(), math.comb(2 * n, n) / 4**n
        assert abs(share - known) < 4.0 * math.sqrt(known * (1.0 - known) / 20000)


LOCKED = {"restitution": 0.9, "amplitude": 0.4, "launch_velocity": 1.0}


@pytest.mark.parametrize(
    ("noise", "known"),
    [
        ({"kick_noise": 1e-3 / 1.9}, (5.7136e-6, -7.3178e-6, 1.4636e-5)),
        ({"drive_noise": 1e-3}, (5.7136e-8, -7.3178e-8, 1.4636e-7)),
    ],
)
def test_the_covariance_about_a_locked_orbit(noise, known):
    """S = J S J^T + Q, within the standard error of 200 realizations or 1 %."""
    phase = 0.5 - math.asin(0.1 / 0.4) / (2.0 * math.pi)
    found = vs.simulate(
        **UNITS, **LOCKED, **STILL | noise, launch_time=phase, duration=400.0,
        noise_stream=np.arange(200),
    )  # fmt: skip
    landing, left = (found[n].values[:, 0, 60:380] for n in ("landing_time", "rebound_velocity"))
    x, u = landing - np.rint(landing - phase) - phase, left - 1.0
    for one, other, value in ((x, x, known[0]), (x, u, known[1]), (u, u, known[2])):
        means = (one * other).mean(axis=1)
        assert abs(means.mean() - value) < max(0.01 * abs(value), 4 * means.std() / 14.1)


def test_how_far_apart_two_particles_in_one_slot_stay():
    """sqrt(2 S_xx) under separate noise of their kicks, roundings under noise of the drive."""
    phase = 0.5 - math.asin(0.1 / 0.4) / (2.0 * math.pi)
    scene = {**UNITS, **LOCKED, "launch_time": [phase, phase + 1e-3], "duration": 600.0}
    kick = vs.simulate(**scene, **STILL | {"kick_noise": 1e-3 / 1.9}, noise_stream=np.arange(60))
    apart = np.diff(kick.landing_time.values[:, :, 300:580], axis=1)
    assert apart.std() == pytest.approx(math.sqrt(2 * 5.7136e-6), rel=0.05)
    drive = vs.simulate(**scene, **STILL | {"drive_noise": 1e-3}, noise_stream=np.arange(10))
    apart = np.diff(drive.landing_time.values[:, :, 500:590], axis=1)
    assert np.abs(apart).max() < 1e-10


@each_of(
    ("given", "words"),
    [
        ({"kick_noise": -0.1}, "kick_noise = -0.1.*at least 0"),
        ({"restitution_noise": math.nan}, "restitution_noise = nan.*not a finite number"),
        ({"drive_noise": 0.1, "base": "moving"}, "drive_noise: needs base = .*would jump"),
        ({"kick_noise": 0.1, "particles": 2**26 + 1}, "particles.*at most 67108864"),
        ({"kick_noise": 0.1, "realizations": 2**36 + 1}, "realizations.*at most 68719476736"),
        ({"noise_seed": -1}, "noise_seed = -1.*at least 0"),
    ],
)
def test_noise_that_is_refused(given, words):
    with pytest.raises(vs.errors.SpecError, match=words):
        vs.sweep(**given)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"noise_stream": 1}, "noise_stream.*nothing is random"),
        ({"noise_stream": [0, 0.5], "kick_noise": 0.1}, "noise_stream.*whole numbers"),
        ({"noise_stream": 2**36, "kick_noise": 0.1}, r"noise_stream.*below 2\*\*36"),
    ],
)
def test_streams_that_are_refused(given, words):
    with pytest.raises(vs.errors.SpecError, match=words):
        vs.simulate(**given)


def test_noise_in_a_table_obeys_the_rules_of_its_key():
    table = {"restitution": [0.8, 0.9], "amplitude": [1.0, 1.1]}
    table |= {name: [0.0, 0.1] for name in ALL}
    found = vs.sweep(design=table, duration=5.0)
    assert found.noise_stream.values.tolist() == [0.0, 1.0]
    with pytest.raises(vs.errors.TableError, match="drive_noise"):
        vs.sweep(design=table, duration=5.0, base="moving")
