"""``vvc-bench fly`` as its users run it."""

import os
import re
import subprocess
import sys

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from test_flight_files import read_csv

import vvc_bench
from vvc_bench import flight, sim
from vvc_bench.cli import main
from vvc_bench.experts import APPENDIX_C, pid_commands
from vvc_bench.sim.units import DEGREES_PER_RADIAN


def run(*arguments, cwd=None):
    """The real process."""
    command = [sys.executable, "-W", "error", "-m", "vvc_bench", *map(str, arguments)]
    environment = os.environ | {"PYTHONUTF8": "1"}
    return subprocess.run(command, capture_output=True, text=True, encoding="utf-8", cwd=cwd, env=environment)


def summary(text):
    """The printed lines by their name."""
    return dict(re.findall(r"^(\S[\w ]*?) {2,}(.*)$", text, re.MULTILINE))


def test_a_flight_from_end_to_end(tmp_path):
    done = run("fly", "--goal", "220,20,-60", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    names = [f"goal_220_20_-60.{ending}" for ending in ("acmi", "csv", "parquet", "png")]
    assert sorted(path.name for path in (tmp_path / "flights").iterdir()) == names
    frame = read_csv(tmp_path / "flights" / "goal_220_20_-60.csv")
    pd.testing.assert_frame_equal(frame, pd.read_parquet(tmp_path / "flights" / "goal_220_20_-60.parquet"))
    said = summary(done.stdout)
    assert said["goal"] == "220 m/s, path angle 20°, azimuth -60°"
    assert said["flown"] == "40 s, reference dynamics at 10 Hz"
    assert said["load factor"].startswith(f"largest {frame['load_factor_g'].abs().max():.2f} g")
    assert said["altitude"].startswith(f"least {frame['altitude_m'].min():.0f} m")
    last = frame.iloc[-1]
    assert said["final errors"].startswith(f"speed {last['speed_mps'] - 220:+.1f} m/s")
    reached = float(re.fullmatch(r"after ([\d.]+) s: within 10 m/s and 3° for 10 steps in a row", said["reached"])[1])
    assert reached < 40.0
    near = frame[(frame["time_s"] > reached - 0.95) & (frame["time_s"] <= reached)]
    assert len(near) == 10
    assert (abs(near["speed_mps"] - 220) < 10).all()
    assert (abs(near["path_angle_deg"] - 20) < 3).all()


def test_options_reach_the_flight(tmp_path, capsys):
    options = [
        "--altitude-m",
        "6000",
        "--speed-mps=230",
        "--heading-deg",
        "-90",
        "--seconds",
        "3",
        "--frequency-hz",
        "20",
    ]
    options += ["--dynamics", "accurate", "--expert", "appendix-c", "--wind-north-mps", "-5", "--delay-steps", "2"]
    assert main(["fly", "--goal=180.5,-10,170", *options, "--output", str(tmp_path), "--format", "parquet, acmi"]) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["goal_180.5_-10_170.acmi", "goal_180.5_-10_170.parquet"]
    assert summary(capsys.readouterr().out)["flown"] == "3 s, accurate dynamics at 20 Hz"

    settings = sim.Settings(dynamics="accurate", frequency_hz=20)
    conditions = sim.make_conditions(wind_north_mps=-5, delay_steps=2)
    state = sim.start(settings, altitude_m=6000, speed_mps=230, heading_deg=-90, conditions=conditions)
    goal = np.array([180.5, -10 / DEGREES_PER_RADIAN, 170 / DEGREES_PER_RADIAN])
    expected = flight.fly(
        settings,
        state,
        lambda row: pid_commands(row[None], goal[None], APPENDIX_C)[0],
        3,
        goal=goal,
        conditions=conditions,
    )
    written = pd.read_parquet(tmp_path / "goal_180.5_-10_170.parquet")
    pd.testing.assert_frame_equal(written, flight.to_frame(expected), check_exact=True)
    said = pq.read_schema(tmp_path / "goal_180.5_-10_170.parquet").metadata
    assert b'"wind_north_mps": -5.0' in said[b"conditions"]


def test_a_flight_ends_at_the_ground(tmp_path, capsys):
    assert (
        main(["fly", "--goal", "250,-60,0", "--altitude-m", "500", "--output", str(tmp_path), "--format", "csv"]) == 0
    )
    said = summary(capsys.readouterr().out)
    assert said["flown"].endswith(", into the ground")
    altitude = read_csv(tmp_path / "goal_250_-60_0.csv")["altitude_m"]
    assert altitude.iloc[-1] < 0.0 <= altitude.iloc[:-1].min()


def test_a_goal_that_is_not_reached_is_no_error(tmp_path, capsys):
    assert main(["fly", "--goal", "300,80,0", "--seconds", "1", "--output", str(tmp_path), "--format", "csv"]) == 0
    assert summary(capsys.readouterr().out)["reached"].startswith("no: not within 10 m/s and 3°")


def test_an_older_file_is_replaced(tmp_path, capsys):
    path = tmp_path / "goal_200_0_0.csv"
    path.write_text("old")
    assert main(["fly", "--goal", "200,0,0", "--seconds", "1", "--output", str(tmp_path), "--format", "csv"]) == 0
    assert len(read_csv(path)) == 11
    assert list(tmp_path.iterdir()) == [path]
    assert str(path) in capsys.readouterr().out


def test_every_condition_is_an_option(capsys):
    with pytest.raises(SystemExit) as done:
        main(["fly", "--help"])
    assert done.value.code == 0
    text = capsys.readouterr().out
    for name in sim.columns(sim.Conditions):
        assert f"--{name.replace('_', '-')} " in text


def test_version_and_help_do_not_load_the_simulator():
    for option, expected in (("--version", f"vvc-bench {vvc_bench.__version__}"), ("--help", "fly one flight")):
        code = (
            "import sys, atexit; from vvc_bench.cli import main\n"
            "heavy = ('numba', 'pandas', 'pyarrow', 'matplotlib')\n"
            "atexit.register(lambda: print([name for name in heavy if name in sys.modules]))\n"
            f"main(['{option}'])"
        )
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
        assert done.returncode == 0
        assert expected in done.stdout
        assert done.stdout.rstrip().endswith("[]")


BAD = {
    "two numbers": (["--goal", "220,20"], "a goal is three numbers, speed_mps,path_angle_deg,azimuth_deg"),
    "words": (["--goal", "fast,up,left"], "as in 220,20,-60; got 'fast,up,left'"),
    "empty": (["--goal", ""], "a goal is three numbers"),
    "not a number": (["--goal", "nan,0,0"], "speed_mps must be a finite number"),
    "negative speed": (["--goal", "-5,20,-60"], "speed_mps must be a finite number in [0, 1000], got -5"),
    "too steep": (["--goal", "200,91,0"], "path_angle_deg must be a finite number in [-90, 90], got 91"),
    "infinite": (["--goal=200,0,-inf"], "azimuth_deg must be a finite number"),
    "no goal": ([], "the following arguments are required: --goal"),
    "format": (
        ["--goal", "220,0,0", "--format", "csv,bmp"],
        "unknown format 'bmp'; choose from csv, parquet, acmi, png",
    ),
    "dynamics": (["--goal", "220,0,0", "--dynamics", "real"], "invalid choice: 'real'"),
    "no trim": (["--goal", "220,0,0", "--altitude-m", "20000", "--speed-mps", "90"], "no trim at 20000 m and 90 m/s"),
    "NaN altitude": (["--goal", "220,0,0", "--altitude-m", "nan"], "altitude_m must be a finite number"),
    "no duration": (["--goal", "220,0,0", "--seconds", "0"], "a flight lasts more than 0 and at most 3600 seconds"),
    "too long": (["--goal", "220,0,0", "--seconds", "1e9"], "at most 3600 seconds, got '1e9'"),
    "frequency": (["--goal", "220,0,0", "--frequency-hz", "1000"], "frequency_hz must lie in [1, 100], got 1000"),
    "gusts": (["--goal", "220,0,0", "--gust-intensity-mps", "-1"], "gust_intensity_mps must lie in [0, 50], got -1"),
    "condition": (["--goal", "220,0,0", "--wind-north-mps", "strong"], "invalid float value: 'strong'"),
    "option": (["--goal", "220,0,0", "--colour", "red"], "unrecognized arguments: --colour red"),
}


def check_refusal(code, out, err, message):
    assert code == 2
    assert out == ""
    assert message in err
    assert err.startswith("vvc-bench")
    assert err.count("\n") == 1
    assert err.endswith("\n")


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_one_clear_line_and_no_file(name, tmp_path, capsys):
    arguments, message = BAD[name]
    try:
        code = main(["fly", *arguments, "--output", str(tmp_path / "flights")])
    except SystemExit as stopped:
        code = stopped.code
    check_refusal(code, *capsys.readouterr(), message)
    assert list(tmp_path.rglob("*.*")) == []


@pytest.mark.parametrize("name", ["negative speed", "no trim", "format"])
def test_bad_input_to_the_real_process(name, tmp_path):
    arguments, message = BAD[name]
    done = run("fly", *arguments, cwd=tmp_path)
    check_refusal(done.returncode, done.stdout, done.stderr, message)
    assert list(tmp_path.rglob("*.*")) == []


def test_a_folder_that_cannot_be_made(tmp_path):
    occupied = tmp_path / "occupied"
    occupied.write_text("a file")
    done = run("fly", "--goal", "220,0,0", "--output", occupied / "flights")
    check_refusal(done.returncode, done.stdout, done.stderr, f"cannot write {occupied / 'flights'}: Not a directory")
    assert occupied.read_text() == "a file"


@pytest.mark.parametrize(("arguments", "message"), [([], "required: COMMAND"), (["soar"], "invalid choice: 'soar'")])
def test_commands_are_named(arguments, message, capsys):
    with pytest.raises(SystemExit) as stopped:
        main(arguments)
    check_refusal(stopped.value.code, *capsys.readouterr(), message)


def test_an_interrupted_flight_leaves_no_file(tmp_path, capsys, monkeypatch):
    def interrupted(*_arguments, **_options):
        raise KeyboardInterrupt

    monkeypatch.setattr("vvc_bench.cli.fly.fly", interrupted)
    assert main(["fly", "--goal", "220,0,0", "--output", str(tmp_path)]) == 130
    assert capsys.readouterr().err == "vvc-bench fly: interrupted\n"
    assert list(tmp_path.iterdir()) == []
