"""A flight as a value and as files: nothing lost, nothing half written, the same figures in every format."""

import csv
import dataclasses
import importlib.util
import json
import math
import re
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

import vvc_bench
from vvc_bench import flight, sim
from vvc_bench.experts import WEIGHT_COMPENSATED, Goal, pid_commands
from vvc_bench.flight import acmi, files
from vvc_bench.sim.units import DEGREES_PER_RADIAN

SETTINGS = sim.Settings(frequency_hz=20)
GOAL = np.array([220.0, 20.0 / DEGREES_PER_RADIAN, -60.0 / DEGREES_PER_RADIAN])
WIDTH = len(sim.State._fields)


def pilot(row):
    return pid_commands(row[None], GOAL[None], WEIGHT_COMPENSATED)[0]


@pytest.fixture(scope="module")
def flown():
    """A climbing turn that arrives, in wind and with control delay."""
    conditions = sim.make_conditions(wind_east_mps=5.0, delay_steps=2)
    state = sim.start(SETTINGS, conditions=conditions)
    return flight.fly(SETTINGS, state, pilot, seconds=16, goal=GOAL, conditions=conditions)


@pytest.fixture(scope="module")
def aimless():
    """Deflections held for a second, without a goal."""
    settings = sim.Settings(control_mode="end_to_end")
    return flight.fly(settings, sim.start(settings), lambda _: [0.0, -0.02, 0.0, 0.2], seconds=1)


def read_csv(path):
    """A CSV file to the last bit; pandas' own reader rounds in some versions, and warns when told not to in others."""
    with path.open(encoding="utf-8", newline="") as file:
        names, *rows = csv.reader(file)
    return pd.DataFrame([[float(cell or "nan") for cell in row] for row in rows], columns=names)


# The value


def test_flying_the_commands_again_gives_the_states(flown):
    assert flown.states.shape == (321, WIDTH + 2 * 3)
    assert flown.commands.shape == (320, 3)
    for before, command, after in zip(flown.states, flown.commands, flown.states[1:], strict=False):
        np.testing.assert_array_equal(sim.step(before, command, flown.settings, flown.conditions), after)


def test_the_frame_has_every_quantity_in_outside_units(flown):
    frame = flight.to_frame(flown)
    commands = [f"command_{name}" for name in sim.columns(sim.GuidanceCommand)]
    goal = ["goal_speed_mps", "goal_path_angle_deg", "goal_azimuth_deg"]
    assert list(frame) == ["time_s", *sim.columns(sim.State), *commands, *goal]
    np.testing.assert_allclose(frame["time_s"], np.arange(321) * 0.05, atol=1e-12)
    np.testing.assert_array_equal(frame["altitude_m"], flown.history.altitude)
    np.testing.assert_allclose(frame["roll_deg"], np.degrees(flown.history.roll), rtol=1e-9)
    np.testing.assert_allclose(frame["command_roll_rate_degps"][:-1], np.degrees(flown.commands[:, 0]), rtol=1e-9)
    assert frame[commands].iloc[-1].isna().all()
    assert frame.notna().sum().sum() == frame.size - len(commands)
    np.testing.assert_allclose(frame[goal], np.tile([220.0, 20.0, -60.0], (321, 1)), rtol=1e-9)


def test_without_a_goal_there_are_no_goal_columns(aimless):
    frame = flight.to_frame(aimless)
    assert [name for name in frame if name.startswith("goal")] == []
    assert [name for name in frame if name.startswith("command")] == [
        *("command_aileron_deg", "command_elevator_deg", "command_rudder_deg", "command_throttle")
    ]
    with pytest.raises(ValueError, match=r"no goal; give one to fly\(..., goal=...\)"):
        flight.time_to_reach(aimless)


def with_speeds(flown, speeds):
    """The flight with other speeds, pointing at its goal all the time."""
    states = np.tile(flown.states[0], (len(speeds), 1))
    states[:, sim.State._fields.index("speed")] = speeds
    for name in ("path_angle", "azimuth"):
        states[:, sim.State._fields.index(name)] = getattr(Goal(*GOAL), name)
    return dataclasses.replace(flown, states=states, commands=np.zeros((len(speeds) - 1, 3)))


@pytest.mark.parametrize(
    ("near", "step"),
    [
        ([0, *[1] * 10], 10),
        ([0, *[1] * 9], math.inf),
        ([*[1] * 10], math.inf),  # the start is no step
        ([*[1] * 11], 10),
        ([0, *[1] * 9, 0, *[1] * 12], 20),
    ],
)
def test_reaching_takes_ten_steps_in_a_row(flown, near, step):
    made = with_speeds(flown, [229.9 if is_near else 230.1 for is_near in near])
    assert flight.time_to_reach(made) == step / 20


def test_reaching_takes_the_direction(flown):
    made = with_speeds(flown, [220.0] * 11)
    made.states[:, sim.State._fields.index("azimuth")] += 3.1 / DEGREES_PER_RADIAN / math.cos(GOAL[1])
    np.testing.assert_allclose(np.degrees(flight.direction_errors(made)), 3.1, atol=0.01)
    assert flight.time_to_reach(made) == math.inf


def test_errors_go_the_shorter_way_round(flown):
    made = dataclasses.replace(flown, goal=np.array([200.0, 0.0, 3.0]), states=flown.states.copy())
    made.states[:, sim.State._fields.index("azimuth")] = -3.0
    np.testing.assert_allclose(flight.goal_errors(made).azimuth, 2 * math.pi - 6.0)


def test_a_pilot_cannot_change_the_record():
    def vandal(row):
        row[:] = 0.0
        return [0.0, 1.0, 0.2]

    assert (flight.fly(SETTINGS, sim.start(SETTINGS), vandal, seconds=1).states[:, 0] > 100.0).all()


def test_stopping_early_keeps_the_last_state():
    start = sim.start(SETTINGS)
    made = flight.fly(SETTINGS, start, pilot, seconds=9, stop=lambda row: row[sim.State._fields.index("steps")] == 7)
    assert made.states[-1, sim.State._fields.index("steps")] == 7
    assert len(made.commands) == 7


def test_a_flight_ends_before_a_state_that_is_not_finite(tmp_path):
    state = sim.start_from(SETTINGS, airspeed_mps=1e60, altitude_m=1000.0)
    made = flight.fly(SETTINGS, state, lambda _: [0.0, 1.0, 0.0], seconds=2, goal=[200.0, 0.0, 0.0])
    assert np.isfinite(made.states).all()
    assert made.commands.shape == (1, 3)
    for name in ("csv", "parquet", "acmi"):
        flight.write_flight(made, tmp_path / f"short.{name}")


@pytest.mark.parametrize("seconds", [0.0, -1.0, math.nan, math.inf])
def test_a_duration_must_make_sense(seconds):
    with pytest.raises(ValueError, match="seconds must be positive and finite"):
        flight.fly(SETTINGS, sim.start(SETTINGS), pilot, seconds)


def test_shapes_must_fit(flown):
    with pytest.raises(ValueError, match="one row"):
        flight.fly(SETTINGS, flown.states, pilot, seconds=1)
    with pytest.raises(ValueError, match="finite values"):
        flight.fly(SETTINGS, np.full(WIDTH, np.nan), pilot, seconds=1)
    with pytest.raises(ValueError, match="azimuth_deg must be a finite number"):
        flight.fly(SETTINGS, flown.states[0], None, seconds=1, goal=[200.0, 0.0, 60.0])
    with pytest.raises(ValueError, match=r"got states \(321, 48\), commands \(319, 3\)"):
        dataclasses.replace(flown, commands=flown.commands[1:])
    with pytest.raises(ValueError, match=r"goal must be speed, path_angle, azimuth"):
        dataclasses.replace(flown, goal=np.zeros(2))
    with pytest.raises(ValueError, match="path_angle_deg must be a finite number"):
        dataclasses.replace(flown, goal=np.array([200.0, 20.0, 0.0]))


# CSV and Parquet


def test_csv_and_parquet_hold_the_frame_to_the_last_bit(flown, aimless, tmp_path):
    for made in (flown, aimless):
        frame = flight.to_frame(made)
        csv = read_csv(flight.write_flight(made, tmp_path / "a" / "flight.csv"))
        parquet = pd.read_parquet(flight.write_flight(made, tmp_path / "a" / "flight.parquet"))
        pd.testing.assert_frame_equal(csv, frame, check_exact=True)
        pd.testing.assert_frame_equal(parquet, frame, check_exact=True)
    assert sorted(path.name for path in (tmp_path / "a").iterdir()) == ["flight.csv", "flight.parquet"]


def test_a_parquet_file_says_how_to_fly_it_again(flown, tmp_path):
    schema = pq.read_schema(flight.write_flight(flown, tmp_path / "flight.parquet"))
    said = {key.decode(): value.decode() for key, value in schema.metadata.items()}
    assert said["vvc_bench_version"] == vvc_bench.__version__
    assert json.loads(said["goal"]) == pytest.approx({"speed_mps": 220.0, "path_angle_deg": 20.0, "azimuth_deg": -60.0})
    settings = sim.Settings(**json.loads(said["settings"]))
    assert settings == flown.settings
    conditions = sim.make_conditions(**json.loads(said["conditions"]))
    np.testing.assert_array_equal(conditions, flown.conditions)
    start = sim.start(settings, conditions=conditions)
    np.testing.assert_array_equal(flight.fly(settings, start, pilot, 16, conditions=conditions).states, flown.states)


def test_parquet_columns_carry_their_units(flown, tmp_path):
    schema = pq.read_schema(flight.write_flight(flown, tmp_path / "flight.parquet"))
    units = {name: schema.field(name).metadata[b"unit"].decode() for name in schema.names}
    assert units["time_s"] == "s"
    assert units["roll_rate_degps"] == units["command_roll_rate_degps"] == "degps"
    assert units["goal_path_angle_deg"] == "deg"
    assert all(schema.field(name).metadata[b"meaning"] for name in schema.names)


# Tacview


def parse_acmi(text):
    """Header lines, the properties said of each object once, and (time, object → properties) for each frame."""
    lines = text.splitlines()
    frames, header = [], []
    for line in lines:
        if line.startswith("#"):
            frames.append((float(line[1:]), {}))
            continue
        if not frames:
            header.append(line)
            continue
        name, *properties = re.split(r"(?<!\\),", line)
        frames[-1][1].setdefault(name, {}).update(part.split("=", 1) for part in properties)
    return header, frames


def test_acmi_header(flown, tmp_path):
    text = flight.write_flight(flown, tmp_path / "flight.acmi").read_text("utf-8")
    header, frames = parse_acmi(text)
    assert header[:3] == ["FileType=text/acmi/tacview", "FileVersion=2.2", f"0,ReferenceTime={acmi.REFERENCE_TIME}"]
    assert r"0,Title=Goal 220 m/s\, path angle 20°\, azimuth -60°" in header
    aircraft = frames[0][1][acmi.AIRCRAFT]
    assert (aircraft["Type"], aircraft["Name"]) == ("Air+FixedWing", "F-16")
    assert aircraft["LockedTarget"] == acmi.GOAL_MARKER
    assert "\r" not in text


def test_acmi_frames_agree_with_the_states(flown):
    _, frames = parse_acmi(acmi.acmi_text(flown))
    times = np.array([time for time, _ in frames])
    assert (np.diff(times) > 0.0).all()
    np.testing.assert_allclose(times, flown.time, atol=1e-4)
    table = flight.to_frame(flown)
    places = np.array([frame[acmi.AIRCRAFT]["T"].split("|") for _, frame in frames], dtype=float)
    longitude, latitude, altitude, roll, pitch, yaw, u, v, heading = places.T
    metres_per_degree = math.pi / 180 * 6378137.0  # at the reference point on the equator
    for written, column, tolerance in (
        (longitude * metres_per_degree, "east_m", 2e-3),
        (latitude * metres_per_degree, "north_m", 2e-3),
        (altitude, "altitude_m", 1e-3),
        (roll, "roll_deg", 1e-3),
        (pitch, "pitch_deg", 1e-3),
        (yaw, "yaw_deg", 1e-3),
        (u, "east_m", 1e-3),
        (v, "north_m", 1e-3),
        (heading, "yaw_deg", 1e-3),
    ):
        np.testing.assert_allclose(written, table[column], atol=tolerance, err_msg=column)
    for name, column in (
        *(("TAS", "airspeed_mps"), ("AOA", "angle_of_attack_deg"), ("AOS", "sideslip_deg")),
        *(("VerticalGForce", "load_factor_g"), ("Throttle", "throttle")),
    ):
        written = np.array([frame[acmi.AIRCRAFT][name] for _, frame in frames], dtype=float)
        np.testing.assert_allclose(written, table[column], atol=1e-3, err_msg=name)
    mach = np.array([frame[acmi.AIRCRAFT]["Mach"] for _, frame in frames], dtype=float)
    assert mach[0] == pytest.approx(200.0 / (20.0468 * math.sqrt(288.15 - 0.0065 * 5000.0)), abs=1e-4)


def test_acmi_marker_points_where_the_goal_does(flown):
    _, frames = parse_acmi(acmi.acmi_text(flown))
    for _, frame in frames[::50]:
        own, marker = (np.array(frame[name]["T"].split("|"), dtype=float) for name in (acmi.AIRCRAFT, acmi.GOAL_MARKER))
        east, north, up = marker[3] - own[6], marker[4] - own[7], marker[2] - own[2]
        assert math.degrees(math.atan2(east, north)) == pytest.approx(-60.0, abs=0.01)
        assert math.degrees(math.atan2(up, math.hypot(east, north))) == pytest.approx(20.0, abs=0.01)


def test_acmi_bookmarks_the_moment_of_reaching(flown, aimless):
    lines = acmi.acmi_text(flown).splitlines()
    bookmarks = [i for i, line in enumerate(lines) if "Bookmark" in line]
    assert len(bookmarks) == 1
    frame = next(line for line in lines[bookmarks[0] :: -1] if line.startswith("#"))
    assert float(frame[1:]) == pytest.approx(flight.time_to_reach(flown))
    assert acmi.GOAL_MARKER + "," not in acmi.acmi_text(aimless)


# The picture


def test_png_is_a_picture_of_the_size_it_says(flown, aimless, tmp_path):
    for made in (flown, aimless):
        path = flight.write_flight(made, tmp_path / "flight.png")
        content = path.read_bytes()
        assert content[:8] == b"\x89PNG\r\n\x1a\n"
        assert struct.unpack(">II", content[16:24]) == (1920, 1080)
        from matplotlib.image import imread

        pixels = imread(path)[:, :, :3]
        for half in (pixels[:, :1000], pixels[:, 1200:]):
            assert 0.01 < (half < 0.95).any(axis=2).mean() < 0.6, "neither empty nor covered"


def test_plots_leave_pyplot_alone():
    code = (
        "import sys, numpy as np; from vvc_bench import flight, sim; from vvc_bench.flight.plot import plot\n"
        "s = sim.Settings(); plot(flight.Flight(s, None, np.stack([sim.start(s)]), np.zeros((0, 3))))\n"
        "assert 'matplotlib.pyplot' not in sys.modules"
    )
    subprocess.run([sys.executable, "-W", "error", "-c", code], check=True)


# Files appear whole or not at all


@pytest.mark.parametrize("failure", [KeyboardInterrupt, OSError("No space left on device")])
@pytest.mark.parametrize("name", ["csv", "parquet", "acmi", "png"])
def test_an_interrupted_write_leaves_the_old_file(flown, tmp_path, monkeypatch, name, failure):
    path = tmp_path / f"flight.{name}"
    path.write_bytes(b"the old file")

    def half(_flight, place):
        Path(place).write_bytes(b"half of")
        raise failure

    monkeypatch.setitem(files.FORMATS, name, files.FORMATS[name]._replace(write=half))
    with pytest.raises(type(failure) if isinstance(failure, OSError) else failure):
        flight.write_flight(flown, path)
    assert path.read_bytes() == b"the old file"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("name", ["csv", "parquet", "acmi", "png"])
def test_a_file_that_does_not_read_back_is_not_put_in_place(flown, tmp_path, monkeypatch, name):
    known = files.FORMATS[name]

    def truncated(made, place):
        known.write(dataclasses.replace(made, states=made.states[:-1], commands=made.commands[:-1]), place)
        if name == "png":
            place.write_bytes(place.read_bytes()[:-20])

    monkeypatch.setitem(files.FORMATS, name, known._replace(write=truncated))
    with pytest.raises(OSError, match="does not read back as it should"):
        flight.write_flight(flown, tmp_path / f"flight.{name}")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["flight.txt", "flight", "flight.CSV.gz"])
def test_unknown_formats_are_refused(flown, tmp_path, name):
    with pytest.raises(ValueError, match="choose from csv, parquet, acmi, png"):
        flight.write_flight(flown, tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_without_matplotlib_the_extra_is_named(flown, tmp_path, monkeypatch):
    find_spec = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "matplotlib" else find_spec(name))
    assert flight.available_formats() == ["csv", "parquet", "acmi"]
    with pytest.raises(ImportError, match=re.escape("pip install vvc-bench[plot]")):
        flight.write_flight(flown, tmp_path / "flight.png")
    assert list(tmp_path.iterdir()) == []
