"""Flights written as the public code writes them, read back; other people's files, refused."""

import dataclasses
import importlib.util
import io
import stat
import tarfile
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from public_flights import NAMES, SCENARIO, TASK, files, flights, fly, long_table
from reference_binary import scratch_folder

from vvc_bench.datasets.catalogue import PID
from vvc_bench.datasets.legacy import import_recordings, to_episodes
from vvc_bench.datasets.recordings import (
    ACTIONS,
    STATES,
    Recordings,
    UnknownLayoutError,
    read_recordings,
    read_table,
)
from vvc_bench.experts import APPENDIX_C
from vvc_bench.rollout import Episodes, fly_law
from vvc_bench.tasks import TASKS, make_task

RES = ["v", "mu", "chi", "length"]


@pytest.fixture(scope="module")
def flown() -> Episodes:
    return fly()


def check_same(came: Episodes, flown: Episodes) -> None:
    for name in ("goals", "offsets", "starts", "observations", "final_observations", "actions", "events"):
        np.testing.assert_array_equal(getattr(came, name), getattr(flown, name))
    np.testing.assert_allclose(came.rewards, flown.rewards, atol=1e-5)
    assert np.isnan(came.deflections).all()
    assert np.isnan(came.load_factors).all()


def in_goal_order(came: Episodes) -> Episodes:
    return came.select(np.lexsort(came.goals.T[::-1]))


def write_folder(folder: Path, contents: dict[str, str]) -> Path:
    folder.mkdir()
    for name, text in contents.items():
        (folder / name).write_text(text)
    return folder


def write_zip(path: Path, contents: dict[str, str]) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in contents.items():
            archive.writestr(f"data/{name}", text)
    return path


def write_tar(path: Path, contents: dict[str, str]) -> Path:
    with tarfile.open(path, "w:gz") as archive:
        for name, text in contents.items():
            member = tarfile.TarInfo(f"./data/{name}")
            member.size = len(text.encode())
            archive.addfile(member, io.BytesIO(text.encode()))
    return path


@pytest.mark.parametrize(
    ("name", "write"), [("folder", write_folder), ("archive.zip", write_zip), ("archive.tar.gz", write_tar)]
)
def test_one_file_for_each_flight(
    flown: Episodes, tmp_path: Path, name: str, write: Callable[[Path, dict[str, str]], Path]
) -> None:
    recordings = read_recordings(write(tmp_path / name, files(flown) | {"notes.txt": "nothing"}))
    assert len(recordings.goals_flown) == len(flown) + 1
    assert recordings.frequency_hz == 10
    index = {"goals": len(flown) + 1, "reached": len(flown), "without_a_file": 0, "of_another_length": 0}
    assert recordings.notes["index"] == index
    came, report = to_episodes(recordings, SCENARIO, "public")
    check_same(in_goal_order(came), flown)
    assert set(came.sources) == {"public"}
    everything = {"flights": len(flown), "same_after_one_step": len(flown), "same_throughout": len(flown)}
    assert report["reflown"] == everything | {"reaching": len(flown)}
    assert report["judged"] == {"reached_at_the_end": len(flown), "ended_earlier": 0}
    assert report["rows_hold"] == "the state after the action"
    assert report["unknown"] == ["deflections", "load_factors"]


@pytest.mark.skipif(not importlib.util.find_spec("flycraft"), reason="flycraft is not installed: vvc-bench[reference]")
def test_flights_of_the_public_binaries_are_flown_again_as_they_were(tmp_path: Path) -> None:
    """Written by the public writer's loop, expert and aircraft, among them one to a goal that it misses."""
    goals = [(200, 0, 15), (240, 5, -30), (220, 0, 60), (300, 85, 0)]
    with scratch_folder():
        logged = {goal: public_flight(*goal) for goal in goals}
    folder = write_folder(
        tmp_path / "folder",
        {f"traj_{v}_{mu}_{chi}.csv": log.to_csv(index=False) for (v, mu, chi), log in logged.items() if len(log)}
        | {
            "res.csv": pd.DataFrame([(*goal, len(log)) for goal, log in logged.items()]).to_csv(index=False, header=RES)
        },
    )
    came, report = to_episodes(read_recordings(folder), PID, "public")
    assert report["rows_hold"] == "the state after the action"
    assert report["judged"] == {"reached_at_the_end": 3, "ended_earlier": 0}
    assert report["reflown"] == {"flights": 3, "same_after_one_step": 3, "same_throughout": 3, "reaching": 3}
    assert report["index"] == {"goals": 4, "reached": 3, "without_a_file": 0, "of_another_length": 0}
    assert {tuple(goal) for goal in came.goals} == set(goals[:3])


def public_flight(v: int, mu: int, chi: int) -> pd.DataFrame:
    """What the public code logs of a flight; nothing if the goal is missed in 60 s."""
    from flycraft.planes.utils.f16Classes import ControlLaw, Guide, PlaneModel

    guide, law, aircraft = Guide(), ControlLaw(stepTime=0.1), PlaneModel(5000, 200, stepTime=0.1)
    state, rows = aircraft.getPlaneState(), []
    for step in range(600):
        guide.step({"v": v, "mu": mu, "chi": chi}, state)
        action = guide.getOutputDict()
        action["pla"] = min(max(action["pla"], 0.0), 1.0)
        law.step(action, state)
        aircraft.step(law.getOutputDict())
        state = aircraft.getPlaneState()  # the same dictionary as before, which is how the public log comes by it
        states = [state[name.removeprefix("s_")] for name in STATES]
        rows.append([step * 0.1, *states, *(action[name.removeprefix("a_")] for name in (*ACTIONS, "a_rud"))])
        last = np.array(rows[-10:])[:, 4:7]
        if len(last) == 10 and (np.abs(last - (v, mu, chi)).mean(axis=0) < (10, 1, 1)).all():
            return pd.DataFrame(rows, columns=NAMES)
    return pd.DataFrame()


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_one_long_table(flown: Episodes, tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"table.{ending}"
    table = long_table(flown)
    pq.write_table(table, path) if ending == "parquet" else table.to_pandas().to_csv(path, index=False)
    check_same(to_episodes(read_recordings(path), SCENARIO, "public").episodes, flown)


def test_goals_cut_where_there_is_no_time(flown: Episodes) -> None:
    came, report = to_episodes(read_table(long_table(flown, time=False)), SCENARIO, "public")
    check_same(came, flown)
    assert "frequency_hz" in report["assumed"]


def test_without_goals_what_was_achieved_is_the_goal(flown: Episodes) -> None:
    came, report = to_episodes(read_table(long_table(flown, goals=False)), SCENARIO, "public")
    np.testing.assert_array_equal(came.offsets, flown.offsets)
    np.testing.assert_array_equal(came.actions, flown.actions)
    assert (np.abs(came.goals - flown.goals) < [10, 1, 1]).all()
    assert came.reached.all()
    assert report["goals"].startswith("not recorded")


def test_an_achieved_azimuth_may_lie_across_south(flown: Episodes) -> None:
    table = long_table(flown.select([0]), goals=False).to_pandas()
    table["s_chi"] = np.where(np.arange(len(table)) % 2, 179.0, -179.0)
    goal = to_episodes(read_table(pa.Table.from_pandas(table)), SCENARIO, "public").episodes.goals[0]
    assert abs(goal[2]) == pytest.approx(180.0)


def test_rows_that_begin_at_the_start_hold_the_state_before_the_action(flown: Episodes) -> None:
    table = long_table(flown).to_pandas()
    table[list(STATES)] = flown.observations.astype(float)
    came, report = to_episodes(read_table(pa.Table.from_pandas(table)), SCENARIO, "public")
    assert report["rows_hold"] == "the state before the action"
    np.testing.assert_array_equal(came.lengths, flown.lengths - 1)
    for e in range(len(flown)):
        one, other = came.select([e]), flown.select([e])
        np.testing.assert_array_equal(one.observations, other.observations[:-1])
        np.testing.assert_array_equal(one.final_observations[0], other.observations[-1])
        np.testing.assert_array_equal(one.actions, other.actions[:-1])
    assert report["reflown"]["same_throughout"] == len(flown)


def test_another_frequency_is_flown_at_that_frequency() -> None:
    fast = dataclasses.replace(SCENARIO, settings=dataclasses.replace(SCENARIO.settings, frequency_hz=20.0))
    quick = fly_law(fast, [[200.0, 5.0, 20.0]], APPENDIX_C).episodes
    (table,) = flights(quick)
    table["time"] = np.round(np.arange(len(table)) * 0.05, 2)
    came, report = to_episodes(read_table(pa.Table.from_pandas(table)), SCENARIO, "public")
    assert came.scenario.settings.frequency_hz == 20.0
    assert report["reflown"]["same_throughout"] == 1


def test_mirrored_records_are_no_flights_and_that_is_said(flown: Episodes) -> None:
    turning = flown.select(flown.goals[:, 2] > 0)
    table = long_table(turning).to_pandas()
    for name in ("s_phi", "s_psi", "s_chi", "s_p", "a_p", "target_chi"):
        table[name] *= -1
    came, report = to_episodes(read_table(pa.Table.from_pandas(table)), SCENARIO, "public")
    assert came.reached.all()
    assert report["reflown"]["same_after_one_step"] == len(turning)
    assert report["reflown"]["same_throughout"] < len(turning)


def test_a_flight_that_ours_rules_do_not_count_ends_without_an_event(flown: Episodes) -> None:
    """Cut one step short, and gone on after reaching."""
    table = long_table(flown.select([0]))
    came, report = to_episodes(read_table(table.slice(0, len(table) - 1)), SCENARIO, "public")
    assert came.final_events.tolist() == [0]
    assert report["judged"] == {"reached_at_the_end": 0, "ended_earlier": 0}
    longer = table.to_pandas()
    longer = pd.concat([longer, longer.iloc[-1:].assign(time=longer["time"].iloc[-1] + 0.1)])
    came, report = to_episodes(read_table(pa.Table.from_pandas(longer)), SCENARIO, "public")
    assert (came.events[:-1] == 0).all()
    assert report["judged"]["ended_earlier"] == 1


def test_the_index_is_compared_with_the_files_which_count(flown: Episodes, tmp_path: Path) -> None:
    contents = files(flown)
    name = next(name for name in contents if name.startswith("traj"))
    del contents[name]
    lines = contents["res.csv"].splitlines()
    contents["res.csv"] = "\n".join([*lines[:-1], lines[-1] + "0"])
    recordings = read_recordings(write_folder(tmp_path / "folder", contents))
    assert len(recordings.offsets) == len(flown)
    assert recordings.notes["index"]["without_a_file"] == 1
    assert recordings.notes["index"]["of_another_length"] == 1


def test_an_import_is_a_dataset_that_says_so(flown: Episodes, tmp_path: Path) -> None:
    dataset = import_recordings(
        write_folder(tmp_path / "folder", files(flown)), tmp_path / "imported", scenario=SCENARIO
    )
    assert dataset.name == "imported"
    check_same(in_goal_order(dataset.read()), flown)
    assert dataset.manifest["counts"]["goals_flown"] == len(flown) + 1
    assert dataset.manifest["last_events"] == {"reach_target": len(flown), "none": 0}
    coverage = dataset.manifest["metrics"]["table_1"]["coverage_percent"]
    assert coverage == pytest.approx(100 * len(flown) / (len(flown) + 1))
    said = dataset.manifest["specification"]["imported"]
    assert said["from"] == "folder"
    assert said["unknown"] == ["deflections", "load_factors"]


def test_coverage_is_a_share_of_the_papers_grid_where_nothing_else_is_said(flown: Episodes, tmp_path: Path) -> None:
    pq.write_table(long_table(flown), tmp_path / "table.parquet")
    manifest = import_recordings(tmp_path / "table.parquet", tmp_path / "on-grid").manifest
    assert manifest["counts"]["goals_flown"] == 50_715
    assert manifest["metrics"]["table_1"]["coverage_percent"] == pytest.approx(100 * len(flown) / 50_715)
    pq.write_table(long_table(flown, goals=False), tmp_path / "table.parquet")
    manifest = import_recordings(tmp_path / "table.parquet", tmp_path / "off-grid").manifest
    assert manifest["counts"]["goals_flown"] == len(flown)


@pytest.mark.parametrize("missing", ["s_v", "a_nz"])
def test_other_columns_are_refused_and_shown(flown: Episodes, missing: str) -> None:
    table = long_table(flown).drop_columns([missing]).append_column("horses", pa.array([7.5] * len(flown.rewards)))
    with pytest.raises(
        UnknownLayoutError, match=r"no known layout\. Found columns: time, .*horses=7\.5.*Needed: s_phi"
    ):
        read_table(table)


def test_a_table_without_times_and_goals_is_refused(flown: Episodes) -> None:
    with pytest.raises(UnknownLayoutError, match="and time or a goal"):
        read_table(long_table(flown, goals=False, time=False))
    with pytest.raises(UnknownLayoutError, match="these 0 rows"):
        read_table(long_table(flown).slice(0, 0))


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (np.nan, "column s_v has (None|nan) in row 3, where a finite number must be"),
        ("fast", "column s_v has a value that is no number: .*fast"),
    ],
)
def test_values_that_are_no_numbers_are_refused(flown: Episodes, value: object, expected: str) -> None:
    table = long_table(flown.select([0])).to_pandas()
    table["s_v"] = table["s_v"].astype(str if isinstance(value, str) else object)
    table.loc[3, "s_v"] = value
    with pytest.raises(ValueError, match=expected):
        read_table(pa.Table.from_pandas(table))


def test_times_with_gaps_are_refused(flown: Episodes) -> None:
    table = long_table(flown.select([0]))
    with pytest.raises(ValueError, match=r"rows are 0\.1 s apart, but time goes from 0\.4 to 0\.6 in row 5"):
        read_table(pa.concat_tables([table.slice(0, 5), table.slice(6)]))


def test_goals_out_of_bounds_are_refused(flown: Episodes) -> None:
    table = long_table(flown.select([0])).to_pandas().assign(target_mu=100.0)
    with pytest.raises(ValueError, match="path_angle_deg"):
        read_table(pa.Table.from_pandas(table))


def test_a_folder_of_something_else_is_refused(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "folder", {"horses.csv": "a,b\n1,2\n"})
    with pytest.raises(UnknownLayoutError, match=r"no file named like traj_200_10_-30\.csv.*found horses\.csv"):
        read_recordings(folder)
    (folder / "traj_200_10_0.csv").write_text("a,b\n1,2\n")
    with pytest.raises(UnknownLayoutError, match=r"traj_200_10_0\.csv: these 1 rows are in no known layout"):
        read_recordings(folder)


def test_two_flights_in_one_file_are_refused(flown: Episodes, tmp_path: Path) -> None:
    twice = pd.concat(flights(flown.select([0])) * 2).to_csv(index=False)
    with pytest.raises(ValueError, match=f"time restarts in row {flown.lengths[0]}"):
        read_recordings(write_folder(tmp_path / "folder", {"traj_200_10_0.csv": twice}))


# Archives from strangers


@pytest.mark.parametrize(
    "name", ["../traj_1_1_1.csv", "/tmp/traj_1_1_1.csv", "a/../../traj_1_1_1.csv", "C:\\traj_1_1_1.csv", "C:/traj.csv"]
)
@pytest.mark.parametrize("kind", ["zip", "tar"])
def test_members_that_point_out_of_the_archive_are_refused(tmp_path: Path, name: str, kind: str) -> None:
    path = tmp_path / f"archive.{kind}"
    if kind == "zip":
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr(zipfile.ZipInfo(name), "x")
    else:
        with tarfile.open(path, "w") as tape:
            tape.addfile(tarfile.TarInfo(name))
    with pytest.raises(ValueError, match="points out of the archive"):
        read_recordings(path)
    assert [each.name for each in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("kind", [tarfile.SYMTYPE, tarfile.LNKTYPE, tarfile.CHRTYPE, tarfile.FIFOTYPE])
def test_links_and_devices_are_refused(tmp_path: Path, kind: bytes) -> None:
    member = tarfile.TarInfo("traj_200_10_0.csv")
    member.type, member.linkname = kind, "/etc/passwd"
    with tarfile.open(tmp_path / "archive.tar", "w") as tape:
        tape.addfile(member)
    with pytest.raises(ValueError, match="is a link or a device"):
        read_recordings(tmp_path / "archive.tar")
    entry = zipfile.ZipInfo("traj_200_10_0.csv")
    entry.external_attr = (stat.S_IFLNK | 0o777) << 16
    with zipfile.ZipFile(tmp_path / "archive.zip", "w") as archive:
        archive.writestr(entry, "/etc/passwd")
    with pytest.raises(ValueError, match="is a link or a device"):
        read_recordings(tmp_path / "archive.zip")


def test_bombs_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_zip(tmp_path / "archive.zip", {"traj_200_10_0.csv": "0" * 10**6})
    assert path.stat().st_size < 10_000
    monkeypatch.setattr("vvc_bench.datasets.recordings.LARGEST_BYTES", 10**6 - 1)
    with pytest.raises(ValueError, match="1 files of 1000000 bytes in all"):
        read_recordings(path)
    lying = path.read_bytes().replace((10**6).to_bytes(4, "little"), (10).to_bytes(4, "little"))
    (tmp_path / "lying.zip").write_bytes(lying)
    with pytest.raises((ValueError, zipfile.BadZipFile), match=r"does not have the 10 bytes|Bad CRC"):
        read_recordings(tmp_path / "lying.zip")


def test_recordings_are_judged_by_rules_that_they_can_be_judged_by(flown: Episodes) -> None:
    recordings: Recordings = read_table(long_table(flown))
    public = dataclasses.replace(SCENARIO, task=make_task(TASK, rules="public_code"))
    with pytest.raises(ValueError, match="not by the public code's"):
        to_episodes(recordings, public, "public")
    paper = dataclasses.replace(SCENARIO, task=make_task(TASKS["hard"].task, step_limit=600))
    judged = to_episodes(recordings, paper, "public").report["judged"]
    assert judged["reached_at_the_end"] + judged["ended_earlier"] > 0
