"""An evaluation is what the flights were: the same from any threads and batches, and as flown by others."""

import dataclasses
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray
from small_policies import BIAS, write_linear, write_network, write_recurrent

from vvc_bench.cli import main
from vvc_bench.datasets.store import Description, write_dataset
from vvc_bench.envs.sub_goals import SubGoalsEnv
from vvc_bench.evaluation import Evaluation, Protocol, evaluate, named_protocol, read_evaluation
from vvc_bench.evaluation.evaluate import EPISODES, SUMMARY, TIMING
from vvc_bench.evaluation.flights import CHUNK, chunks, fly_chunk
from vvc_bench.evaluation.protocols import Drawn
from vvc_bench.experts.pid import APPENDIX_C
from vvc_bench.metrics import best_lengths, final_errors, returns, wear, wilson_interval
from vvc_bench.policies import Agent, open_agent
from vvc_bench.rollout import Episodes, Policy, fly_law, fly_policy, replay


def shortened(name: str, count: int) -> Protocol:
    """A protocol with fewer goals."""
    protocol = named_protocol(name)
    assert isinstance(protocol.drawn, Drawn)
    return dataclasses.replace(protocol, name=f"{name}-{count}", drawn=dataclasses.replace(protocol.drawn, count=count))


@pytest.fixture(scope="module")
def network(tmp_path_factory: pytest.TempPathFactory) -> Agent:
    return open_agent(str(write_network(tmp_path_factory.mktemp("policies") / "network.onnx")))


@pytest.fixture(scope="module")
def flown(network: Agent) -> Evaluation:
    return evaluate(network, shortened("normal-1k-v0", 300), threads=1)


def files(evaluation: Evaluation, folder: Path) -> dict[str, bytes]:
    evaluation.write(folder)
    return {name: (folder / name).read_bytes() for name in (EPISODES, SUMMARY)}


@pytest.mark.parametrize(("threads", "batch_size"), [(2, None), (2, 1), (2, 100_000), (5, 3 * CHUNK)])
def test_threads_and_batches_do_not_change_a_byte(
    network: Agent, flown: Evaluation, tmp_path: Path, threads: int, batch_size: int | None
) -> None:
    again = evaluate(network, shortened("normal-1k-v0", 300), threads=threads, batch_size=batch_size)
    assert files(again, tmp_path / "again") == files(flown, tmp_path / "first")


def test_another_process_writes_the_same_bytes(tmp_path: Path) -> None:
    policy = write_recurrent(tmp_path / "memory.onnx")
    arguments = ["evaluate", "--policy", str(policy), "--protocol", "robust-all-1k-v0", "--seeds", "3", "--output"]
    assert main([*arguments, str(tmp_path / "here"), "--threads", "2"]) == 0
    subprocess.run(
        [sys.executable, "-m", "vvc_bench", *arguments, str(tmp_path / "there"), "--threads", "1"],
        check=True,
        env=os.environ | {"PYTHONHASHSEED": "1"},
        capture_output=True,
    )
    for name in (EPISODES, SUMMARY):
        assert (tmp_path / "here" / name).read_bytes() == (tmp_path / "there" / name).read_bytes()


def test_the_law_flies_as_in_its_own_loop() -> None:
    protocol = shortened("normal-1k-v0", 300)
    found = evaluate(open_agent("pid"), protocol, threads=1).episodes
    expected = fly_law(protocol.scenario, protocol.goals, APPENDIX_C, seeds=protocol.seeds)
    reached = found[found["success"]]
    assert 150 < len(reached) < 300
    assert np.array_equal(protocol.goals[reached["goal"]], expected.episodes.goals)
    assert np.array_equal(reached["length_steps"], expected.episodes.lengths)
    np.testing.assert_array_equal(reached["return"], returns(expected.episodes))
    np.testing.assert_array_equal(
        reached[["speed_error_mps", "path_angle_error_deg", "azimuth_error_deg"]], final_errors(expected.episodes)
    )


@pytest.mark.parametrize("name", ["normal-1k-v0", "robust-all-1k-v0"])
def test_recorded_flights_are_what_their_actions_fly(network: Agent, name: str) -> None:
    protocol = shortened(name, 40)
    chunk = list(chunks(protocol, 5))[-1]
    episodes = fly_chunk(network, chunk).episodes
    again = replay(chunk.scenario, episodes.goals, episodes.actions, episodes.offsets, seeds=episodes.seeds)
    for field in dataclasses.fields(Episodes):
        mine, theirs = getattr(episodes, field.name), getattr(again, field.name)
        if isinstance(mine, np.ndarray) and field.name != "sources":
            np.testing.assert_array_equal(mine, theirs, err_msg=field.name)


def test_success_is_that_of_a_policy_flown_otherwise(tmp_path: Path) -> None:
    agent = open_agent(str(write_linear(tmp_path / "linear.onnx")))
    protocol = shortened("medium-1k-v0", 300)
    found = evaluate(agent, protocol).episodes
    other = fly_policy(protocol.scenario, protocol.goals, agent.begin(protocol.seeds), seeds=protocol.seeds)
    assert 30 < found["success"].sum() < 300
    assert np.array_equal(found["success"], (other.last_events & 1) != 0)


def test_rows_are_ordered_and_measures_agree_with_those_of_sets(flown: Evaluation) -> None:
    protocol, episodes = shortened("normal-1k-v0", 300), flown.episodes
    assert episodes["goal"].tolist() == list(range(300))
    goals = episodes[["goal_speed_mps", "goal_path_angle_deg", "goal_azimuth_deg"]]
    assert np.array_equal(goals, protocol.goals)
    assert set(episodes["termination"]) <= {
        "reach_target",
        "crash",
        "extreme_state",
        "time_limit",
        "move_away",
        "roll_on",
    }
    assert ((episodes["termination"] == "reach_target") == episodes["success"]).all()


def test_wear_of_each_flight_adds_up_to_that_of_all(network: Agent) -> None:
    chunk = next(chunks(shortened("normal-1k-v0", 50), 0))
    episodes = fly_chunk(network, chunk).episodes
    rows = evaluate(network, chunk.protocol).episodes
    every, weights = wear(episodes), episodes.lengths / episodes.lengths.sum()
    for name, command in every.commands.items():
        assert command.bang_bang_percent == pytest.approx((rows[f"{name}_at_bounds_percent"] * weights).sum())
    for name, deflection in every.deflections.items():
        assert deflection.travel_per_s == pytest.approx((rows[f"{name}_travel_per_s"] * weights).sum(), rel=1e-6)


def test_the_summary_counts_what_the_table_holds(flown: Evaluation) -> None:
    episodes, summary = flown.episodes, flown.summary
    count = int(episodes["success"].sum())
    low, high = wilson_interval(count, 300)
    assert summary["success"]["count"] == count
    assert summary["success"]["low"] == pytest.approx(float(low))
    assert summary["success"]["high"] == pytest.approx(float(high))
    assert sum(summary["terminations"].values()) == 300
    reached = episodes[episodes["success"]]
    assert summary["length_steps"]["mean"] == pytest.approx(reached["length_steps"].mean())
    assert summary["direction_error_deg"]["std"] == pytest.approx(reached["direction_error_deg"].std(ddof=0))
    for region in summary["regions"].values():
        assert sum(region["episodes"]) == 300
        assert sum(region["count"]) == count
    assert summary["time_ratio"] == {"mean": None, "std": None}


def test_seeds_matter_where_something_is_drawn_and_are_kept_in_the_order_given() -> None:
    protocol = shortened("robust-gusts-1k-v0", 30)
    both = evaluate(open_agent("pid"), protocol, seeds=(7, 2))
    assert both.episodes["seed"].tolist() == [7] * 30 + [2] * 30
    alone = evaluate(open_agent("pid"), protocol, seeds=(2,)).episodes
    pd.testing.assert_frame_equal(both.episodes[30:].reset_index(drop=True), alone)
    assert (both.episodes["return"][:30].to_numpy() != alone["return"].to_numpy()).all()
    assert [each["seed"] for each in both.summary["by_seed"]] == [7, 2]
    for seeds in ((), (1, 1), (-1,)):
        with pytest.raises(ValueError, match="seeds must be"):
            evaluate(open_agent("pid"), protocol, seeds=seeds)


def test_conditions_take_turns_and_are_flown() -> None:
    protocol = shortened("robust-wind-1k-v0", 8)
    found = evaluate(open_agent("pid"), protocol)
    assert found.episodes["condition"].tolist() == [0, 1, 2, 3, 0, 1, 2, 3]
    assert [each["episodes"] for each in found.summary["conditions"]] == [2, 2, 2, 2]
    still = evaluate(open_agent("pid"), shortened("hard-1k-v0", 8))
    assert (found.episodes["return"] != still.episodes["return"]).all()


def test_sub_goals_are_flown_as_in_their_environment() -> None:
    protocol = shortened("turn-climb-v0", 3)
    rows = evaluate(open_agent("pid-compensated"), protocol).episodes
    policy = open_agent("pid-compensated").begin(np.zeros(1, dtype=np.int64))
    assert protocol.starts is not None
    for row, (altitude, speed, heading) in zip(rows.itertuples(), protocol.starts.tolist(), strict=True):
        environment = SubGoalsEnv(altitude_m=altitude, speed_mps=speed, heading_deg=heading)
        seen, info = environment.reset(seed=0)
        total, ended = 0.0, False
        while not ended:
            action = np.asarray(policy({name: values[None] for name, values in seen.items()}))[0]
            seen, reward, terminated, truncated, info = environment.step(action)
            total, ended = total + reward, terminated or truncated
        assert (row.sub_goals_reached, row.length_steps) == (info["sub_goals_reached"], info["steps"])
        assert (row.success, row.termination) == (info["is_success"], info["termination"])
        assert row[rows.columns.get_loc("return") + 1] == pytest.approx(total, rel=1e-5)
    assert rows["sub_goals_reached"].max() == 3


def test_lengths_are_compared_with_the_best_known(flown: Evaluation, network: Agent) -> None:
    protocol = shortened("normal-1k-v0", 300)
    own = fly_law(protocol.scenario, protocol.goals[:100], APPENDIX_C).episodes
    found = evaluate(network, protocol, best=best_lengths([own])).episodes
    known = found["time_ratio"].notna()
    assert 0 < known.sum() <= len(own)
    assert not known[100:].any()
    first = int(np.flatnonzero(known)[0])
    (steps,) = own.lengths[(own.goals == protocol.goals[first]).all(axis=1)]
    assert found["time_ratio"][first] == flown.episodes["length_steps"][first] / steps


class Odd:
    """A policy that answers with something else at some step."""

    name = "odd"

    def __init__(self, answer: Any, step: int = 3) -> None:
        self.answer, self.step = answer, step

    def begin(self, seeds: NDArray[np.int64]) -> Policy:
        steps = iter(range(1000))

        def policy(_observed: dict[str, NDArray[np.float32]]) -> Any:
            fine = np.zeros((len(seeds), 3), dtype=np.float32)
            return self.answer(fine) if next(steps) == self.step else fine

        return policy

    def describe(self) -> dict[str, str | None]:
        return {"kind": "python", "name": self.name, "sha256": None}


def nan_in_row_7(actions: NDArray[np.float32]) -> NDArray[np.float32]:
    actions[7, 1] = np.nan
    return actions


def test_answers_that_are_no_actions_are_refused_with_goal_and_step() -> None:
    protocol = shortened("normal-1k-v0", 20)
    with pytest.raises(ValueError, match=r"load_factor_g is NaN at step 3 of goal 7 \(\d"):
        evaluate(Odd(nan_in_row_7), protocol)
    with pytest.raises(ValueError, match=r"shape \(256, 3\): roll_rate_degps.* at step 3 .*shape \(256, 4\)"):
        evaluate(Odd(lambda _: np.zeros((CHUNK, 4))), protocol)
    with pytest.raises(ValueError, match=r"gave shape \(3,\)"):
        evaluate(Odd(lambda _: np.zeros(3)), protocol)
    with pytest.raises(ValueError, match="shape"):
        evaluate(open_agent("pid"), shortened("normal-end-to-end-1k-v0", 20))


def test_beyond_bounds_is_clipped_and_counted(tmp_path: Path) -> None:
    wild = open_agent(str(write_linear(tmp_path / "wild.onnx", BIAS + np.array([0, 0, 50], dtype=np.float32))))
    rows = evaluate(wild, shortened("normal-1k-v0", 5)).episodes
    assert (rows["clipped_commands"] >= rows["length_steps"]).all()
    assert (rows["throttle_at_bounds_percent"] == 100.0).all()


def test_progress_counts_every_flight(network: Agent) -> None:
    told: list[tuple[int, int]] = []
    evaluate(network, shortened("normal-1k-v0", 300), seeds=(0, 1), progress=lambda *so_far: told.append(so_far))
    assert told[0] == (0, 600)
    assert told[-1] == (600, 600)


def test_what_is_written_is_read_back(flown: Evaluation, tmp_path: Path) -> None:
    folder = flown.write(tmp_path / "result")
    assert sorted(path.name for path in folder.iterdir()) == sorted((EPISODES, SUMMARY, TIMING))
    read = read_evaluation(folder)
    pd.testing.assert_frame_equal(read.episodes, flown.episodes, check_dtype=False)
    assert (read.summary, read.timing) == (flown.summary, flown.timing)
    assert read.timing["latency"]["median_s"] > 0
    assert not {"wall_s", "latency", "threads"} & set(read.summary)
    (folder / TIMING).unlink()
    assert read_evaluation(folder).timing == {}


def test_other_peoples_files_are_left_alone(flown: Evaluation, tmp_path: Path) -> None:
    folder = flown.write(tmp_path / "result")
    flown.write(folder)
    (folder / "notes.txt").write_text("mine")
    with pytest.raises(FileExistsError, match=r"notes\.txt"):
        flown.write(folder)
    assert (folder / "notes.txt").read_text() == "mine"


def test_folders_that_hold_no_evaluation_are_refused(flown: Evaluation, tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"no episodes\.parquet"):
        read_evaluation(tmp_path)
    folder = flown.write(tmp_path / "result")
    summary = (folder / SUMMARY).read_text()
    (folder / SUMMARY).write_text("{")
    with pytest.raises(ValueError, match="no JSON"):
        read_evaluation(folder)
    (folder / SUMMARY).write_text("{}")
    with pytest.raises(ValueError, match="no 'protocol'"):
        read_evaluation(folder)
    (folder / SUMMARY).write_text(summary.replace('"episodes": 300', '"episodes": 299'))
    with pytest.raises(ValueError, match="299 episodes, and there are 300"):
        read_evaluation(folder)
    (folder / SUMMARY).write_text(summary)
    (folder / EPISODES).write_bytes(b"PAR1")
    with pytest.raises(ValueError, match="no Parquet"):
        read_evaluation(folder)
    pd.DataFrame({"seed": [0]}).to_parquet(folder / EPISODES)
    with pytest.raises(ValueError, match="no column 'goal'"):
        read_evaluation(folder)


def test_the_command_evaluates_several_policies(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    policy = write_linear(tmp_path / "last.onnx")
    arguments = ["evaluate", "--policy", str(policy), "random", "--protocol", "normal-1k-v0"]
    assert main([*arguments, "--output", str(tmp_path / "results"), "--json"]) == 0
    documents = json.loads(capsys.readouterr().out)
    assert [document["policy"]["name"] for document in documents] == ["last", "random"]
    for document in documents:
        read = read_evaluation(document.pop("folder"))
        assert read.summary == document


def test_the_command_tells_goals_seen_in_training(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    protocol = named_protocol("normal-1k-v0")
    learned = fly_law(protocol.scenario, protocol.goals[::20]).episodes
    write_dataset(tmp_path / "mine-v0", learned, Description("mine-v0"))
    arguments = ["evaluate", "--policy", "pid", "--protocol", "normal-1k-v0", "--output", str(tmp_path / "out")]
    assert main([*arguments, "--training-set", str(tmp_path / "mine-v0")]) == 0
    assert "goals seen in training: 100.0 %" in capsys.readouterr().out
    summary = read_evaluation(tmp_path / "out").summary
    assert summary["training_set"]["name"] == "mine-v0"
    assert summary["seen"]["episodes"] == summary["seen"]["count"] == len(learned)
    assert summary["unseen"]["episodes"] == 1000 - len(learned)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--policy", "pit", "--protocol", "hard-1k-v0"], "unknown policy 'pit'"),
        (["--policy", "pid", "--protocol", "hardest"], "unknown protocol 'hardest'"),
        (["--policy", "gone.onnx", "--protocol", "hard-1k-v0"], "no policy file gone.onnx"),
        (["--policy", "json:loads", "--protocol", "hard-1k-v0"], "--trust"),
        (["--policy", "pid", "pid", "--protocol", "hard-1k-v0"], "2 policies are called pid"),
        (["--policy", "pid", "--protocol", "hard-1k-v0", "--threads", "0"], "threads must be at least 1"),
        (["--policy", "pid", "--protocol", "hard-end-to-end-1k-v0"], "cannot fly 'end_to_end'"),
    ],
)
def test_bad_arguments_give_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], message: str
) -> None:
    assert main(["evaluate", *arguments, "--output", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()
