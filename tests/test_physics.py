"""The aircraft obeys physics and meets published figures."""

import itertools
import math

import numpy as np
import pytest
from numpy.typing import NDArray

from vvc_bench import sim
from vvc_bench.jit import COMPILED
from vvc_bench.sim.aerodynamics import ALPHA, SIDESLIP, coefficients
from vvc_bench.sim.aircraft import (
    ENGINE_ANGULAR_MOMENTUM,
    GRAVITY,
    INERTIA_X,
    INERTIA_XZ,
    INERTIA_Y,
    INERTIA_Z,
    MASS,
)
from vvc_bench.sim.atmosphere import air_at
from vvc_bench.sim.dynamics import Body, Loads, Vector, air_velocity, ground_velocity, rates
from vvc_bench.sim.fields import degrees
from vvc_bench.sim.gusts import SCALE_LENGTH
from vvc_bench.sim.random_numbers import standard_normals, threefry
from vvc_bench.sim.stepping import Scheme

INDEX = {name: k for k, name in enumerate(sim.State._fields)}
GUSTS = slice(INDEX["gust_forward"], INDEX["gust_normal_lagged"] + 1)
INTEGRATED = slice(0, len(Body._fields))
CONTROLS = [INDEX[name] for name in sim.SurfaceCommand._fields]
END_TO_END = sim.Settings(control_mode="end_to_end")
STILL = sim.make_conditions()


def fly(settings: sim.Settings, states: NDArray, commands: NDArray, conditions: NDArray = STILL) -> NDArray:
    """N aircraft through commands (steps, N, width); shape (steps + 1, N, F)."""
    flown = [states]
    for command in commands:
        flown.append(sim.step_many(flown[-1], command, settings, conditions))
    return np.array(flown)


def random_commands(settings: sim.Settings, steps: int, count: int, *, hold: int = 10) -> NDArray:
    """Anywhere within the bounds, each held for some steps."""
    fields = sim.fields_of(settings.command_fields).values()
    low, high = np.array([(field.low, field.high) for field in fields]).T
    shape = (-(-steps // hold), count, settings.command_width)
    held = np.random.default_rng(11).uniform(low, high, shape)
    return np.repeat(held, hold, axis=0)[:steps]


# Energy


@pytest.mark.parametrize("mode", ["guidance", "end_to_end"])
def test_energy_never_grows_without_thrust(mode: sim.ControlMode) -> None:
    settings = sim.Settings(control_mode=mode, dynamics="accurate")
    states = sim.start(settings, altitude_m=np.full(48, 9000.0), speed_mps=np.linspace(150, 320, 48))
    commands = random_commands(settings, 400, 48)
    commands[..., -1] = 0.0
    flown = fly(settings, states, commands)
    energy = GRAVITY * flown[..., INDEX["altitude"]] + 0.5 * flown[..., INDEX["airspeed"]] ** 2
    backwards = np.abs(flown[..., INDEX["angle_of_attack"]]) > degrees(170.0)  # where clamped tables push
    forwards = ~(backwards[:-1] | backwards[1:])
    assert forwards.mean() > 0.9
    assert np.diff(energy, axis=0)[forwards].max() < 0.0
    assert np.isfinite(flown).all()


def test_tumbling_flights_keep_angles_that_the_tables_know() -> None:
    settings = sim.Settings(control_mode="end_to_end", dynamics="accurate")
    states = sim.start(settings, heading_deg=np.zeros(300))
    flown = fly(settings, states, random_commands(settings, 400, 300))
    largest = np.abs(flown[..., INDEX["angle_of_attack"]]).max(axis=0)
    assert (largest > degrees(150.0)).any()  # some do tumble
    assert largest.max() <= np.pi
    assert np.abs(flown[..., INDEX["sideslip"]]).max() <= 0.5 * np.pi
    assert np.isfinite(flown).all()


def test_drag_is_positive_everywhere_in_the_tables() -> None:
    for alpha, beta, elevator in itertools.product(ALPHA.node, SIDESLIP.node[::3], (-25.0, 0.0, 25.0)):
        a, b = degrees(alpha), degrees(beta)
        c = coefficients(a, b, 0.0, degrees(elevator), 0.0, 0.0, 0.0, 0.0)
        drag = -(c.cx * math.cos(a) * math.cos(b) + c.cy * math.sin(b) + c.cz * math.sin(a) * math.cos(b))
        assert drag > 0.0, (alpha, beta, elevator)


# Equations of motion


def random_body(rng: np.random.Generator) -> Body:
    attitude = rng.normal(size=4)
    w, x, y, z = attitude / np.linalg.norm(attitude)
    angles, body_rates, position = rng.uniform(-1, 1, 2), rng.uniform(-3, 3, 3), rng.uniform(0, 5000, 3)
    return Body(rng.uniform(50, 400), *angles, *body_rates, w, x, y, z, *position)


@pytest.mark.parametrize("seed", range(20))
def test_rates_are_newton_and_euler(seed: int) -> None:
    """The scalar equations against their vector form: m(v̇ + ω×v) = F + mg and Iω̇ + ω×Iω = M."""
    rng = np.random.default_rng(seed)
    body = random_body(rng)
    load = Loads(*rng.uniform(-1e5, 1e5, 3), *rng.uniform(-1e5, 1e5, 3), 0.0)
    rate = rates(body, air_velocity(body), Vector(0.0, 0.0, 0.0), load, MASS)

    inertia = np.array([[INERTIA_X, 0, -INERTIA_XZ], [0, INERTIA_Y, 0], [-INERTIA_XZ, 0, INERTIA_Z]])
    spin, moment = np.array(body[3:6]), np.array(load[3:6])
    acceleration = np.linalg.solve(inertia, moment - np.cross(spin, inertia @ spin))
    np.testing.assert_allclose(rate[3:6], acceleration, rtol=1e-12, atol=1e-12)

    velocity = np.array(air_velocity(body))
    to_body = rotation(body).T
    linear = np.array(load[:3]) / MASS + to_body @ [0, 0, GRAVITY] - np.cross(spin, velocity)
    step = 1e-6
    ahead, behind = (
        np.array(air_velocity(Body(*(value + sign * step * slope for value, slope in zip(body, rate, strict=True)))))
        for sign in (1, -1)
    )
    np.testing.assert_allclose((ahead - behind) / (2 * step), linear, rtol=1e-7, atol=1e-6)


@pytest.mark.parametrize("seed", range(5))
def test_attitude_turns_with_the_body_rates(seed: int) -> None:
    """Ṙ = R [ω]×, and the ground velocity is R times the air velocity with up for down."""
    body = random_body(np.random.default_rng(seed))
    nothing = Loads(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    rate = rates(body, air_velocity(body), Vector(0.0, 0.0, 0.0), nothing, MASS)
    step = 1e-6
    ahead, behind = (
        rotation(Body(*(value + sign * step * slope for value, slope in zip(body, rate, strict=True))))
        for sign in (1, -1)
    )
    p, q, r = body[3:6]
    cross = np.array([[0, -r, q], [r, 0, -p], [-q, p, 0]])
    np.testing.assert_allclose((ahead - behind) / (2 * step), rotation(body) @ cross, atol=1e-8)
    over_ground = ground_velocity(body, air_velocity(body), sim.STILL)
    north_east_down = rotation(body) @ np.array(air_velocity(body))
    np.testing.assert_allclose(over_ground, north_east_down * [1, 1, -1], rtol=1e-12, atol=1e-9)


def rotation(body: Body) -> NDArray:
    """Body to north-east-down, by rotating each axis with the quaternion product."""
    w, vector = body.quaternion_w, np.array([body.quaternion_x, body.quaternion_y, body.quaternion_z])
    return np.array([turn(w, vector, axis) for axis in np.eye(3)]).T


def turn(w: float, vector: NDArray, axis: NDArray) -> NDArray:
    return axis + 2.0 * w * np.cross(vector, axis) + 2.0 * np.cross(vector, np.cross(vector, axis))


def test_the_engine_turns_pitching_into_yawing() -> None:
    """Gyroscopic moments −h·r about y and h·q about z: with q alone, ṙ gains Ix·h·q/Γ and ṗ gains Ixz·h·q/Γ."""
    settings = sim.Settings(control_mode="end_to_end", frequency_hz=100)
    trim = sim.start(settings)
    rate = degrees(10.0)
    pitching = trim.copy()
    pitching[INDEX["pitch_rate"]] = rate
    after = sim.step(pitching, pitching[CONTROLS], settings)
    per_second = (after - pitching) / settings.time_step
    gamma = INERTIA_X * INERTIA_Z - INERTIA_XZ**2
    assert per_second[INDEX["yaw_rate"]] == pytest.approx(INERTIA_X * ENGINE_ANGULAR_MOMENTUM * rate / gamma, rel=1e-9)
    assert per_second[INDEX["roll_rate"]] == pytest.approx(
        INERTIA_XZ * ENGINE_ANGULAR_MOMENTUM * rate / gamma, rel=1e-9
    )


# Integration


def observed_order(errors: list[float]) -> float:
    """Mean order over steps that are halved each time."""
    return math.log2(errors[0] / errors[-1]) / (len(errors) - 1)


def after_smooth_flight(scheme: Scheme) -> NDArray:
    """Angles and rates after 0.4 s within one cell of every table."""
    settings = sim.Settings(control_mode="end_to_end", dynamics="accurate" if scheme.accurate else "reference")
    vars(settings)["scheme"] = scheme  # other substeps than Settings would choose
    trim = sim.start(settings)
    state = sim.start_from(
        settings,
        airspeed_mps=200,
        altitude_m=5000,
        angle_of_attack_deg=2.5,
        pitch_deg=2.5,
        sideslip_deg=1.0,
        roll_rate_degps=2.0,
    )
    for _ in range(round(0.4 / scheme.time_step)):
        state = sim.step(state, trim[CONTROLS], settings)
    return state[INDEX["angle_of_attack"] : INDEX["yaw_rate"] + 1]


def test_orders_of_the_integrators() -> None:
    truth = after_smooth_flight(Scheme(False, True, 0.1, 400))
    fourth, first = (
        [float(np.linalg.norm(after_smooth_flight(scheme) - truth)) for scheme in schemes]
        for schemes in (
            [Scheme(False, True, 0.1, substeps) for substeps in (2, 4, 8, 16)],
            [Scheme(False, False, 0.1 / parts, 1) for parts in (2, 4, 8, 16)],
        )
    )
    assert observed_order(fourth) == pytest.approx(4.0, abs=0.15)
    assert observed_order(first) == pytest.approx(1.0, abs=0.1)


def test_accurate_dynamics_do_not_depend_on_the_frequency() -> None:
    settings = [
        sim.Settings(control_mode="end_to_end", dynamics="accurate", frequency_hz=frequency) for frequency in (10, 100)
    ]
    states = sim.start(settings[0], speed_mps=np.linspace(150, 300, 16))
    commands = states[:, CONTROLS] + degrees(1.0) * np.random.default_rng(0).uniform(-1, 1, (50, 16, 4))
    slow = fly(settings[0], states, commands)[-1]
    fast = fly(settings[1], states, np.repeat(commands, 10, axis=0))[-1]
    np.testing.assert_allclose(fast[:, INTEGRATED], slow[:, INTEGRATED], rtol=1e-11, atol=1e-11)


def test_quaternion_stays_of_unit_length() -> None:
    settings = sim.Settings(control_mode="end_to_end", dynamics="accurate")
    states = sim.start(settings, heading_deg=np.linspace(-180, 180, 32))
    flown = fly(settings, states, random_commands(settings, 100, 32, hold=3))
    first = INDEX["quaternion_w"]
    length = np.linalg.norm(flown[..., first : first + 4], axis=-1)
    assert np.abs(length - 1.0).max() < 1e-15


# Mass, density and wind


def test_load_factors_go_with_density_and_against_mass() -> None:
    state = {"airspeed_mps": 210, "altitude_m": 4000, "angle_of_attack_deg": 6, "sideslip_deg": 3, "elevator_deg": -4}
    load = slice(INDEX["load_factor_x"], INDEX["load_factor"] + 1)
    nominal = sim.start_from(END_TO_END, **state)[load]
    assert (np.abs(nominal) > 0.03).all()
    for offset in (-0.5, -0.1, 0.2, 1.0):
        heavier = sim.start_from(END_TO_END, conditions=sim.make_conditions(mass_offset=offset), **state)[load]
        denser = sim.start_from(END_TO_END, conditions=sim.make_conditions(density_offset=offset), **state)[load]
        np.testing.assert_allclose(heavier * (1 + offset), nominal, rtol=1e-14)
        np.testing.assert_allclose(denser / (1 + offset), nominal, rtol=1e-14)


def test_mass_and_density_that_cancel_leave_the_trim_angle() -> None:
    alpha = INDEX["angle_of_attack"]
    both = sim.start(END_TO_END, conditions=sim.make_conditions(mass_offset=0.3, density_offset=0.3))
    assert both[alpha] == pytest.approx(sim.start(END_TO_END)[alpha], abs=1e-12)
    assert both[INDEX["thrust"]] == pytest.approx(1.3 * sim.start(END_TO_END)[INDEX["thrust"]], rel=1e-12)


@pytest.mark.parametrize("dynamics", ["reference", "accurate"])
def test_horizontal_wind_moves_the_position_and_nothing_else(dynamics: sim.Dynamics) -> None:
    settings = sim.Settings(dynamics=dynamics)
    wind = sim.make_conditions(wind_north_mps=12.0, wind_east_mps=-7.0)
    states, drifting = (sim.start(settings, speed_mps=np.linspace(160, 260, 8), conditions=c) for c in (STILL, wind))
    commands = random_commands(settings, 200, 8)
    still, windy = fly(settings, states, commands), fly(settings, drifting, commands, wind)

    seconds = settings.time_step * np.arange(201)[:, None]
    np.testing.assert_allclose(windy[..., INDEX["north"]] - still[..., INDEX["north"]], 12.0 * seconds + np.zeros(8))
    np.testing.assert_allclose(windy[..., INDEX["east"]] - still[..., INDEX["east"]], -7.0 * seconds + np.zeros(8))
    moved = ["north", "east", "velocity_north", "velocity_east", "speed", "path_angle", "azimuth"]
    airborne = [k for name, k in INDEX.items() if name not in moved]
    np.testing.assert_array_equal(windy[..., airborne], still[..., airborne])
    velocity = slice(INDEX["velocity_north"], INDEX["velocity_up"] + 1)
    np.testing.assert_allclose(windy[..., INDEX["speed"]], np.linalg.norm(windy[..., velocity], axis=-1), rtol=1e-14)


# Gusts


def dryden_correlation(distance: float, transverse: bool) -> float:
    """Autocorrelation at a distance in m, by integrating MIL-F-8785C's spectrum over the wave number."""
    edge = 400.0
    waves = np.tan(np.linspace(0.0, math.atan(edge), 200_001))  # Ω L, dense where the spectrum is
    spectrum = 1.0 / (1.0 + waves**2)
    if transverse:
        spectrum = 0.5 * (1.0 + 3.0 * waves**2) / (1.0 + waves**2) ** 2
    values = 2.0 / math.pi * spectrum * np.cos(waves * distance / SCALE_LENGTH)
    return float(np.trapezoid(values, waves))


def gust_histories(frequency_hz: float, steps: int, count: int, intensity: float) -> NDArray:
    """Gusts along x, y and z of many aircraft at an airspeed that is held; shape (steps, count, 3)."""
    settings = sim.Settings(control_mode="end_to_end", frequency_hz=frequency_hz)
    conditions = sim.make_conditions(gust_intensity_mps=intensity, seed=np.arange(count))
    level = np.tile(sim.start(settings, speed_mps=250.0), (count, 1))
    states, gusts = level.copy(), []
    for step in range(steps):
        after = sim.step_many(states, level[:, CONTROLS], settings, conditions)
        filtered = after[:, GUSTS]
        forward, side, side_lagged, normal, normal_lagged = filtered.T
        root = math.sqrt(3.0)
        transverse = (root * side + (1.0 - root) * side_lagged, root * normal + (1.0 - root) * normal_lagged)
        gusts.append(np.stack([forward, *transverse], axis=-1))
        states[:, GUSTS] = filtered
        states[:, INDEX["steps"]] = step + 1
    return np.array(gusts)


GUST_AIRCRAFT = 20_000 if COMPILED else 400
FOUR_SIGMA = 4.0 / math.sqrt(GUST_AIRCRAFT)


@pytest.mark.parametrize("frequency", [10.0, 40.0])
def test_gusts_are_dryden_turbulence(frequency: float) -> None:
    """Variance from the first step on, and autocorrelation, do not depend on the step."""
    seconds = (0.5, 1.0, 2.0)
    gusts = gust_histories(frequency, round(frequency * seconds[-1]) + 1, GUST_AIRCRAFT, intensity=3.0) / 3.0
    for step in (0, 1, len(gusts) - 1):
        np.testing.assert_allclose(gusts[step].var(axis=0), 1.0, atol=math.sqrt(2.0) * FOUR_SIGMA)
        np.testing.assert_allclose(gusts[step].mean(axis=0), 0.0, atol=FOUR_SIGMA)
        assert np.abs(np.corrcoef(gusts[step].T) - np.eye(3)).max() < FOUR_SIGMA
    for lag in seconds:
        correlation = np.mean(gusts[0] * gusts[round(lag * frequency)], axis=0)
        expected = [dryden_correlation(250.0 * lag, transverse) for transverse in (False, True, True)]
        np.testing.assert_allclose(correlation, expected, atol=math.sqrt(2.0) * FOUR_SIGMA)


def test_the_integrated_spectrum_is_the_textbook_correlation() -> None:
    for lag in (0.0, 0.3, 1.0, 2.0):
        distance = lag * SCALE_LENGTH
        assert dryden_correlation(distance, False) == pytest.approx(math.exp(-lag), abs=2e-3)
        assert dryden_correlation(distance, True) == pytest.approx(math.exp(-lag) * (1 - lag / 2), abs=4e-3)


def test_gusts_act_on_the_forces_and_not_on_the_velocity_over_the_ground() -> None:
    calm = sim.start(END_TO_END)
    gusty = sim.make_conditions(gust_intensity_mps=5.0, seed=3)
    after = sim.step(calm, calm[CONTROLS], END_TO_END, gusty)
    undisturbed = sim.step(calm, calm[CONTROLS], END_TO_END)
    assert abs(after[INDEX["load_factor"]] - undisturbed[INDEX["load_factor"]]) > 0.01
    assert after[INDEX["north"]] == undisturbed[INDEX["north"]]


@pytest.mark.parametrize(
    ("key", "counter", "expected"),
    [
        ((0, 0), (0, 0), (0x6B200159, 0x99BA4EFE)),
        ((0xFFFFFFFF, 0xFFFFFFFF), (0xFFFFFFFF, 0xFFFFFFFF), (0x1CB996FC, 0xBB002BE7)),
        ((0x13198A2E, 0x03707344), (0x243F6A88, 0x85A308D3), (0xC4923A9C, 0x483DF7A0)),
    ],
)
def test_threefry_known_answers(key: tuple, counter: tuple, expected: tuple) -> None:
    """Random123's vectors for threefry2x32 with 20 rounds."""
    assert threefry(*key, *counter) == expected


def test_normal_numbers_are_normal() -> None:
    values = np.array([standard_normals(seed, counter) for seed in range(60) for counter in range(60)])
    assert np.abs(values.mean(axis=0)).max() < 4 / math.sqrt(len(values))
    np.testing.assert_allclose(values.var(axis=0), 1.0, atol=4 * math.sqrt(2 / len(values)))
    assert abs(np.corrcoef(values.T)[0, 1]) < 4 / math.sqrt(len(values))
    share = np.mean(np.abs(values) < 1.0)
    assert share == pytest.approx(math.erf(math.sqrt(0.5)), abs=4 * 0.47 / math.sqrt(values.size))


# Air


@pytest.mark.parametrize(
    ("altitude", "temperature", "sound_speed"),
    [(0, 288.15, 340.294), (5000, 255.65, 320.529), (11000, 216.65, 295.070), (15000, 216.65, 295.070)],
)
def test_temperature_and_sound_speed_are_standard(altitude: float, temperature: float, sound_speed: float) -> None:
    """ISO 2533 by geopotential altitude."""
    air = air_at(float(altitude), 1.0)
    assert air.sound_speed == pytest.approx(sound_speed, abs=2e-3)
    assert air.sound_speed**2 / (1.4 * 287.05287) == pytest.approx(temperature, rel=2e-5)


def test_sea_level_density_is_standard() -> None:
    assert air_at(0.0, 1.0).density == 1.225


def test_density_falls_with_altitude_and_follows_its_offset() -> None:
    densities = [air_at(altitude, 1.0).density for altitude in np.arange(0.0, 20_001.0, 250.0)]
    assert (np.diff(densities) < 0.0).all()
    assert air_at(5000.0, 1.1).density == pytest.approx(1.1 * air_at(5000.0, 1.0).density, rel=1e-15)


# Actuators, engine and delay


@pytest.mark.parametrize("dynamics", ["reference", "accurate"])
@pytest.mark.parametrize("frequency", [10.0, 50.0])
def test_actuators_and_engine_are_first_order_lags(dynamics: sim.Dynamics, frequency: float) -> None:
    settings = sim.Settings(control_mode="end_to_end", dynamics=dynamics, frequency_hz=frequency)
    lags = sim.make_conditions(actuator_time_constant_s=0.2, engine_time_constant_s=1.5)
    state = sim.start(settings)
    before, wanted = state[CONTROLS].copy(), state[CONTROLS] + [0.05, 0.02, -0.04, 0.3]
    for step in range(1, round(frequency) + 1):
        state = sim.step(state, wanted, settings, lags)
        elapsed = step * settings.time_step
        left = np.exp(-elapsed / np.array([0.2, 0.2, 0.2, 1.5]))
        np.testing.assert_allclose(state[CONTROLS], wanted + (before - wanted) * left, rtol=1e-12)


@pytest.mark.parametrize("dynamics", ["reference", "accurate"])
def test_rate_limit(dynamics: sim.Dynamics) -> None:
    settings = sim.Settings(control_mode="end_to_end", dynamics=dynamics)
    limited = sim.make_conditions(actuator_rate_limit_degps=30.0)
    start = sim.start_from(settings, airspeed_mps=200, altitude_m=5000)
    state, wanted = start, np.array([degrees(10), degrees(-10), degrees(20), 1.0])
    for step in range(1, 11):
        state = sim.step(state, wanted, settings, limited)
        moved = degrees(30.0) * step * settings.time_step
        expected = [min(10.0, moved / degrees(1)), -min(10.0, moved / degrees(1)), min(20.0, moved / degrees(1))]
        np.testing.assert_allclose(state[CONTROLS][:3] / degrees(1), expected, rtol=1e-12)
        assert state[INDEX["throttle"]] == 1.0


@pytest.mark.parametrize("mode", ["guidance", "end_to_end"])
@pytest.mark.parametrize("delay", [1, 3, 7])
def test_a_delayed_command_acts_that_many_steps_later(mode: sim.ControlMode, delay: int) -> None:
    """Until then the start's own command holds, so the flight is that of commands which come later, bit for bit."""
    settings = sim.Settings(control_mode=mode)
    delayed = sim.make_conditions(delay_steps=delay)
    states, waiting = (sim.start(settings, speed_mps=[180, 220], conditions=c) for c in (STILL, delayed))
    commands = random_commands(settings, 40, 2, hold=4)
    names = ["roll_rate", "load_factor", "throttle"] if mode == "guidance" else sim.SurfaceCommand._fields
    hold = np.tile(states[:, [INDEX[name] for name in names]], (delay, 1, 1))
    late = fly(settings, states, np.concatenate([hold, commands[:-delay]]))
    flown = fly(settings, waiting, commands, delayed)
    np.testing.assert_array_equal(flown[..., : len(INDEX)], late)


# Trim


@pytest.mark.parametrize("altitude", range(0, 12_001, 1500))
def test_trim_is_an_equilibrium_or_says_that_there_is_none(altitude: float) -> None:
    settings = sim.Settings(control_mode="end_to_end", frequency_hz=100)
    accelerations = slice(INDEX["airspeed"], INDEX["quaternion_z"] + 1)
    found = 0
    for speed in range(120, 321, 10):
        try:
            state = sim.start(settings, altitude_m=altitude, speed_mps=speed)
        except ValueError as error:
            assert f"no trim at {altitude:g} m and {speed:g} m/s: " in str(error)  # noqa: PT017
            continue
        found += 1
        after = sim.step(state, state[CONTROLS], settings)
        assert np.abs((after - state)[accelerations] / settings.time_step).max() < 1e-9
        assert after[INDEX["altitude"]] == pytest.approx(altitude, abs=1e-12 * max(altitude, 1.0))
    assert found >= 20


def test_trim_holds_without_feedback() -> None:
    settings = sim.Settings(control_mode="end_to_end", dynamics="accurate")
    state = start = sim.start(settings)
    for _ in range(100):
        state = sim.step(state, start[CONTROLS], settings)
    assert state[INDEX["altitude"]] == pytest.approx(5000.0, abs=1e-9)
    assert state[INDEX["airspeed"]] == pytest.approx(200.0, abs=1e-9)
    assert state[INDEX["north"]] == pytest.approx(2000.0, abs=1e-8)
