"""The paper's tables made again: verdicts by their rules, rows of real sets, learners trained and judged end to end."""

import dataclasses
import hashlib
import json
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from small_evaluations import made_up
from small_flights import flights

from vvc_bench.baselines.configurations import GCBC_SMALL, PPO_SMALL, Configuration, amount_of
from vvc_bench.cli import main
from vvc_bench.datasets.catalogue import CATALOGUE, LEARNED, goals_flown
from vvc_bench.datasets.progress import progress_line
from vvc_bench.datasets.sources import load_dataset
from vvc_bench.evaluation import named_protocol
from vvc_bench.metrics import CRITERIA, PUBLISHED, Estimate, Spread, coverage_by_criterion
from vvc_bench.reproduction.rendering import as_markdown
from vvc_bench.reproduction.reproduce import reproduce
from vvc_bench.reproduction.trials import (
    BUDGETS,
    FINE_TUNED,
    GCBC,
    PPO,
    SETS,
    SHIPPED,
    SMALL,
    TABLES_OF_LEARNERS,
    WITHOUT_PENALTY,
    Budget,
    Trial,
    table_2,
    table_3,
)
from vvc_bench.reproduction.verdicts import (
    AGREE,
    DIFFER,
    NO_FIGURE,
    NOT_RUN,
    Verdict,
    judge_learner,
    judge_set,
    judge_smoothness,
)

PAPER = PUBLISHED["pid-v0"].table_1["paper"]
TRAIN = "pip install vvc-bench[train]"


def of_paper(**changes: float) -> dict[str, Any]:
    """The paper's own figures as ours would be, some of them moved."""
    figures = {column: figure._asdict() if isinstance(figure, Spread) else figure for column, figure in PAPER.items()}
    for column, by in changes.items():
        if isinstance(figures[column], dict):
            figures[column]["mean"] += by
        else:
            figures[column] += by
    return figures


# Verdicts


@pytest.mark.parametrize(
    ("changes", "verdict"),
    [
        ({}, AGREE),
        ({"coverage_percent": 0.45}, AGREE),
        ({"coverage_percent": 0.6}, "differ: coverage above by 0.60 points"),
        ({"coverage_percent": -0.6}, "differ: coverage below by 0.60 points"),
        ({"length_steps": 14.9}, AGREE),
        ({"length_steps": -15.1}, "differ: length below by 15.1 steps"),
        ({"path_angle_error_deg": 0.04}, "differ: path angle error above by 0.04°"),
        ({"trajectories": -203}, AGREE),
        (
            {"trajectories": -204, "speed_error_mps": 1},
            "differ: trajectories below by 204; speed error above by 1.00 m/s",
        ),
    ],
)
def test_a_set_agrees_within_tolerances(changes: dict[str, float], verdict: str) -> None:
    assert str(judge_set(of_paper(**changes), PAPER, run=True)) == verdict


def test_a_mean_of_unknown_deviation_agrees_within_two_percent() -> None:
    paper = PUBLISHED["irpo3-aug-v0"].table_1["paper"]
    ours = {"coverage_percent": 90.0, "length_steps": {"mean": 118.9, "std": 60.0}}
    assert str(judge_set(ours, paper, run=True)) == "differ: coverage above by 11.45 points"
    ours["length_steps"] = {"mean": 113.0, "std": 60.0}
    assert str(judge_set(ours, paper, run=True)).endswith("points; length below by 3.6 steps")


def test_samples_are_not_judged_nor_what_the_paper_has_not() -> None:
    assert judge_set(of_paper(), PAPER, run=False) == Verdict(NOT_RUN)
    assert judge_set(of_paper(), {}, run=True) == Verdict(NO_FIGURE)


def test_smoothness_is_judged_where_a_figure_is_known() -> None:
    assert judge_smoothness([0.05, 0.19], None, run=True) == Verdict(NO_FIGURE)
    assert judge_smoothness([0.05, 0.19], (0.25, math.nan), run=False) == Verdict(NOT_RUN)
    assert str(judge_smoothness([0.05, 0.19], (0.25, math.nan), run=True)) == "differ: s1 below by 0.200"
    assert judge_smoothness([0.2501, 0.19], (0.25, math.nan), run=True) == Verdict(AGREE)


def test_a_learner_agrees_if_the_papers_figure_lies_in_the_interval() -> None:
    ours = Estimate(38.0, 35.0, 41.0)
    assert judge_learner(ours, 40.0, run=True) == Verdict(AGREE)
    assert judge_learner(ours, 41.5, run=True) == Verdict(DIFFER, "below by 3.50 points")
    assert judge_learner(ours, 34.0, run=True) == Verdict(DIFFER, "above by 4.00 points")
    assert judge_learner(ours, 34.0, run=False) == Verdict(NOT_RUN)
    assert judge_learner(ours, None, run=True) == Verdict(NO_FIGURE)


# Coverage by other criteria


def angle_deg(first: np.ndarray, second: np.ndarray) -> float:
    """Between two directions, each path angle and azimuth in degrees."""
    (a, b), (c, d) = np.radians(first), np.radians(second)
    along = math.sin(a) * math.sin(c) + math.cos(a) * math.cos(c) * math.cos(b - d)
    return math.degrees(math.acos(min(along, 1.0)))


def test_criteria_are_what_they_say() -> None:
    flown = flights()
    generator = np.random.default_rng(3)
    off = generator.uniform((-12, -1.5, -1.5), (12, 1.5, 1.5), (len(flown), 3))
    flown = dataclasses.replace(flown, goals=flown.final_observations[:, 3:6] + off)
    expected = dict.fromkeys(CRITERIA, 0)
    for e in range(len(flown)):
        goal = flown.goals[e]
        reports = np.vstack([flown.select([e]).observations, flown.final_observations[e]])[1:][-10:, 3:6].astype(float)
        errors = np.abs(reports - goal)
        direction = [angle_deg(report[1:], goal[1:]) for report in reports]
        near = errors[:, 0].mean() < 10.0
        met = (
            near and errors[:, 1].mean() < 1.0 and errors[:, 2].mean() < 1.0,
            near and np.mean(direction) < 1.0,
            bool((errors[:, 0] < 10.0).all() and max(direction) < 3.0),
        )
        for name, reached in zip(CRITERIA, met, strict=True):
            expected[name] += reached
    found = coverage_by_criterion(flown, flown.goals)
    assert found == pytest.approx({name: 100.0 * count / len(flown) for name, count in expected.items()})
    assert len({0, len(flown), *expected.values()}) == 5, "the flights do not tell the criteria apart"


def test_a_set_covers_by_its_own_criterion_what_it_says() -> None:
    for name, criterion in (("pid-sample-v0", "components"), ("search-sample-v0", "task")):
        dataset = load_dataset(name)
        covered = coverage_by_criterion(dataset.read(), goals_flown(name))
        own = dataset.manifest["metrics"]["table_1"]["coverage_percent"]
        assert covered[f"coverage_{criterion}_percent"] == pytest.approx(own)
        assert covered["coverage_direction_percent"] < own or criterion == "components"


# What is in the tables


@pytest.mark.parametrize("budget", BUDGETS.values(), ids=lambda budget: budget.name)
def test_trials_can_be_run(budget: Budget) -> None:
    known: dict[str, Any] = {}
    for _, entries in TABLES_OF_LEARNERS.values():
        for entry in entries(budget):
            assert known.setdefault(entry.name, entry) == entry, "one folder, two trainings"
            demonstrator = getattr(entry, "demonstrator", None)
            if demonstrator:
                assert known.setdefault(demonstrator.name, demonstrator) == demonstrator
                assert demonstrator.configuration.hidden == entry.configuration.hidden
    trials = [entry for entry in known.values() if isinstance(entry, Trial)]
    assert {trial.algorithm for trial in trials} == {"gcbc", "ppo", "sac", "sac-her"}
    for name in budget.protocols:
        named_protocol(name)
    # the sets of learned policies have no samples; everything else is in the catalogue
    learned = {name for name in SETS if CATALOGUE[name].scenario == LEARNED}
    assert {budget.set_name(name) for name in SETS if name not in learned or not budget.samples} <= set(CATALOGUE)


def test_budgets_are_what_they_say() -> None:
    amounts = {
        name: {kind: amount_of(each) for kind, (_, each) in budget.configurations.items()}
        for name, budget in BUDGETS.items()
    }
    assert amounts["laptop"] | {"gcbc": 10, "ppo": 12_000_000, "sac": 150_000} == amounts["laptop"]
    assert amounts["full"] | {"gcbc": 300, "ppo": 200_000_000, "sac": 1_000_000} == amounts["full"]
    assert list(BUDGETS) == ["small", "laptop", "full"]
    assert "no reproduction" in SMALL.says
    assert [budget.judges_learners for budget in BUDGETS.values()] == [False, False, True]
    assert len(BUDGETS["full"].seeds) == 5


# Tables of sets, from the command


def test_the_command_writes_and_prints_tables_of_sets(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = [
        "reproduce",
        "table1",
        "table12",
        "--output",
        str(tmp_path / "results"),
        "--runs",
        str(tmp_path / "runs"),
    ]
    assert main([*arguments, "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    files = {path.name: path.read_bytes() for path in (tmp_path / "results").iterdir()}
    assert sorted(files) == ["table1-small.json", "table1-small.md", "table12-small.json", "table12-small.md"]
    first, twelfth = printed
    assert json.loads(files["table1-small.json"]) == first
    assert json.loads(files["table12-small.json"]) == twelfth
    assert not (tmp_path / "runs").exists()

    sample = load_dataset("pid-sample-v0")
    rows = {row["set"]: row for row in first["rows"]}
    assert list(rows) == list(SETS)
    assert rows["pid-v0"]["hash"] == first["sets"]["pid-sample-v0"] == sample.hash
    measured = sample.manifest["metrics"]["table_1"]
    assert {column: rows["pid-v0"]["ours"][column] for column in measured} == measured
    assert rows["pid-v0"]["paper"]["coverage_percent"] == 20.08
    assert {row["verdict"]["verdict"] for row in rows.values()} == {NOT_RUN, NO_FIGURE}
    assert rows["irpo3-v0"]["ours"] is None
    assert rows["irpo3-v0"]["verdict"]["detail"]
    pitch = next(row for row in twelfth["rows"] if row.get("variable") == "pitch_deg")
    assert pitch["ours"] == sample.manifest["metrics"]["table_12"]["observations"]["pitch_deg"]

    assert main(arguments) == 0
    assert (
        capsys.readouterr().out.encode()
        == b"\n".join(files[f"{name}-small.md"] for name in ("table1", "table12")) + b"\n"
    )
    assert files == {path.name: path.read_bytes() for path in (tmp_path / "results").iterdir()}
    text = files["table1-small.md"].decode()
    assert "a test of the pipeline, no reproduction" in text
    assert "76.22" in text


def test_info_shows_rows_that_are_known_in_part(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    known = {"pid-sample-v0": PUBLISHED["irpo3-aug-v0"]}
    monkeypatch.setattr("vvc_bench.cli.datasets.PUBLISHED", known)
    assert main(["datasets", "info", "pid-sample-v0"]) == 0
    (line,) = [line for line in capsys.readouterr().out.splitlines() if line.startswith("paper")]
    assert line.split() == ["paper", "–", "78.55", "116.6", "–", "–", "–", "–"]


def test_learners_take_the_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    assert main(["reproduce", "all", "--output", str(tmp_path / "results")]) == 2
    error = capsys.readouterr().err
    assert TRAIN in error
    assert error.count("\n") == 1
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["table4"], "invalid choice: 'table4'"),
        (["table1", "--budget", "huge"], "huge"),
        (["table1", "--threads", "0"], "from 1"),
    ],
)
def test_the_command_refuses_on_one_line(
    arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(["reproduce", *arguments])
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


# Tables of learners


def learners_document(**row: Any) -> dict[str, Any]:
    spent = {"unit": "steps", "wall_s": 3000.0, "threads": 2}
    trainings = [{"seed": seed, "done": 131_072, **spent} for seed in range(5)]
    ours = {"hard-1k-v0": {"percent": 38.04, "low": 35.11, "high": 41.0}}
    made = {
        "label": "PPO",
        "paper": None,
        "ours": ours,
        "trainings": trainings,
        "verdict": {"verdict": NO_FIGURE, "detail": ""},
    }
    budget = {"name": "full", "says": "all of it", "protocols": ["hard-1k-v0"], "seeds": [0, 1, 2, 3, 4]}
    return {"table": "table9", "title": "Without demonstrations", "budget": budget, "rows": [made | row]}


def cells(markdown: str) -> list[str]:
    """Of the first row."""
    lines = [line for line in markdown.splitlines() if line.startswith("|")]
    assert len(set(map(len, lines))) == 1, "columns do not stand below each other"
    return [cell.strip() for cell in lines[2].split("|")[1:-1]]


def test_rows_of_learners_say_what_was_spent() -> None:
    assert cells(as_markdown(learners_document())) == [
        "PPO",
        "not at hand",
        "38.0 (35.1 to 41.0)",
        "131,072 steps, 5 seeds, 4.2 h, 2 threads",
        "no paper figure at hand",
    ]


def test_a_table_says_by_which_command_it_was_made() -> None:
    assert "`vvc-bench reproduce table9 --budget full --seeds 5`" in as_markdown(learners_document())
    with pytest.raises(ValueError, match="at least one seed, got 0"):
        SMALL.with_seeds(0)


def test_a_row_that_was_not_run_says_why() -> None:
    missing = learners_document(
        ours=None, trainings=[], paper=40.0, verdict={"verdict": NOT_RUN, "detail": "no policy |\n irpo1"}
    )
    assert cells(as_markdown(missing)) == ["PPO", "40.00", "–", "–", "not run at this budget: no policy / irpo1"]


TINY_PPO = PPO_SMALL._replace(environments=16, steps_of_a_rollout=32, batch_size=256, epochs=2, steps=1500)
TINY: dict[str, tuple[str, Configuration]] = {
    GCBC: ("tiny", GCBC_SMALL._replace(epochs=2)),
    PPO: ("tiny", TINY_PPO),
    FINE_TUNED: ("tiny", TINY_PPO._replace(demonstrator_penalty=1e-3, warm_up_steps=500)),
    WITHOUT_PENALTY: ("tiny-without-penalty", TINY_PPO._replace(warm_up_steps=500)),
}


def sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def test_learners_are_trained_once_judged_and_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for module in ("torch", "imitation", "onnxruntime"):
        pytest.importorskip(module, reason=f"{module} is not installed: {TRAIN}")
    chosen = {"table3": ("Some of it", lambda budget: (table_3(budget)[3], table_3(budget)[-1], table_2(budget)[2]))}
    monkeypatch.setattr("vvc_bench.reproduction.reproduce.TABLES_OF_LEARNERS", chosen)
    budget = dataclasses.replace(SMALL, configurations=TINY, evaluations=1).with_seeds(2)
    output, runs = tmp_path / "results", tmp_path / "runs"

    third = reproduce("table3", budget, output, runs, progress=progress_line)
    kept = {path: (path.stat().st_mtime_ns, sha256(path)) for path in runs.rglob("*") if path.is_file()}
    written = {path: path.read_bytes() for path in output.rglob("*") if path.is_file()}
    assert reproduce("table3", budget, output, runs, progress=progress_line) == third
    assert kept == {path: (path.stat().st_mtime_ns, sha256(path)) for path in runs.rglob("*") if path.is_file()}
    assert written == {path: path.read_bytes() for path in output.rglob("*") if path.is_file()}

    row = third["rows"][0]
    assert [each["run"] for each in row["trainings"]] == [
        f"{name}-seed{seed}" for seed in (0, 1) for name in ("gcbc-search", "gcbc-ppo-search")
    ]
    for each in row["trainings"]:
        copy = output / "trainings" / "small" / f"{each['run']}.json"
        assert each["training_sha256"] == sha256(copy) == sha256(runs / "small" / each["run"] / "training.json")
    for each in row["policies"]:
        assert each["sha256"] == sha256(runs / "small" / f"gcbc-ppo-search-seed{each['seed']}" / "policy-best.onnx")
    for each in row["evaluations"]:
        place = runs / "small" / "evaluations" / f"gcbc-ppo-search-seed{each['seed']}" / each["protocol"]
        assert each["summary_sha256"] == sha256(place / "summary.json")
    result = row["ours"]["normal-1k-v0"]
    assert result["policies"] == 2
    assert result["low"] <= result["percent"] <= result["high"]
    assert third["sets"]["search-sample-v0"] == load_dataset("search-sample-v0").hash

    for row in third["rows"][1:]:
        assert row["ours"] is None or row["name"] in SHIPPED
        assert row["verdict"]["verdict"] == (NO_FIGURE if row["ours"] else NOT_RUN)
        assert row["ours"] or row["verdict"]["detail"]


def test_another_policy_is_judged_anew(tmp_path: Path) -> None:
    pytest.importorskip("torch", reason=f"PyTorch is not installed: {TRAIN}")
    pytest.importorskip("imitation", reason=f"imitation is not installed: {TRAIN}")
    from vvc_bench.policies import open_agent
    from vvc_bench.reproduction.learners import Workplace, _evaluated

    place = Workplace(SMALL, tmp_path, 1, progress_line)
    protocol = named_protocol("normal-1k-v0")
    for name in ("pid", "random", "random"):
        folder = place.evaluation("trial", 0, protocol.name)
        evaluation = _evaluated(open_agent(name), "trial", protocol, folder, place)
        assert evaluation.summary["policy"]["name"] == name


def test_several_policies_are_an_interquartile_mean() -> None:
    pytest.importorskip("torch", reason=f"PyTorch is not installed: {TRAIN}")
    pytest.importorskip("imitation", reason=f"imitation is not installed: {TRAIN}")
    from vvc_bench.reproduction.learners import _result

    evaluations = [made_up(f"policy{k}", 0.3 + 0.05 * k, draw=k) for k in range(5)]
    shares = [100.0 * evaluation.episodes["success"].mean() for evaluation in evaluations]
    several, one = _result(evaluations), _result(evaluations[:1])
    assert several["percent"] == pytest.approx(np.mean(sorted(shares)[1:-1]))
    assert several["mean_std"].mean == pytest.approx(np.mean(shares))
    assert several["low"] < min(shares[1:3]) < several["high"]
    assert one["percent"] == pytest.approx(shares[0])
    assert (one["interval"], one["policies"]) == ("Wilson", 1)
