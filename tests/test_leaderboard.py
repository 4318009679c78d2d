"""Entries made, flown again and ranked; and those of dishonest authors, who may seal anew what they change."""

import dataclasses
import json
import pickle
import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import small_models
from html_page import BROWSERS, laid_out

from vvc_bench.cli import main
from vvc_bench.evaluation import named_protocol, read_evaluation
from vvc_bench.evaluation.summary import summarise
from vvc_bench.leaderboard.claims import differences, same_flights
from vvc_bench.leaderboard.confinement import Limits
from vvc_bench.leaderboard.entries import read_entry
from vvc_bench.leaderboard.render import page_text
from vvc_bench.leaderboard.sandbox import Announced, fly
from vvc_bench.leaderboard.standings import standings
from vvc_bench.leaderboard.submission import Erratum, Submission, parse_submission, sha256
from vvc_bench.leaderboard.submit import About, submit
from vvc_bench.leaderboard.verify import verify_entry
from vvc_bench.policies.onnx import LARGEST_FILE

PROTOCOL = "normal-1k-v0"
ADA = About("Ada", "A law linear in observation and goal.", code="https://example.org/linear")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two honest entries: a model, and chance."""
    root = tmp_path_factory.mktemp("leaderboards")
    model = root.with_name("linear.onnx")
    model.write_bytes(small_models.linear())
    submit(root, str(model), PROTOCOL, ADA)
    submit(root, "random", PROTOCOL, About("Ada", "Chance."))
    return root


@pytest.fixture
def root(made: Path, tmp_path: Path) -> Path:
    """A copy to do harm to."""
    return Path(shutil.copytree(made, tmp_path / "leaderboards"))


@pytest.fixture
def entry(root: Path) -> Path:
    return root / PROTOCOL / "linear"


def seal(folder: Path, change: Callable[[Submission], Submission] = lambda same: same) -> None:
    """Write a submission whose hashes are those of the files, whatever they hold now."""
    path = folder / "submission.json"
    said = parse_submission(path.read_bytes(), path)
    policy: Any = said.policy
    if (folder / "policy.onnx").is_file():
        content = (folder / "policy.onnx").read_bytes()
        policy = dataclasses.replace(policy, sha256=sha256(content), bytes=len(content))
    files = {name: sha256((folder / name).read_bytes()) for name in said.files}
    said = dataclasses.replace(said, policy=policy, files=files, entry=folder.name)
    path.write_bytes(change(said).to_bytes())


def claim(folder: Path, episodes: pd.DataFrame, **summary: object) -> None:
    """Write episodes and the summary that follows from them, but for what is said of it here."""
    episodes.to_parquet(folder / "episodes.parquet", index=False)
    said = json.loads((folder / "summary.json").read_text())
    known = summarise(episodes, named_protocol(PROTOCOL), said["policy"], said["seeds"])
    (folder / "summary.json").write_text(json.dumps(known | summary))


def put_model(folder: Path, content: bytes) -> None:
    """Put another policy in place of the one that made the claims, and say so throughout."""
    (folder / "policy.onnx").write_bytes(content)
    said = json.loads((folder / "summary.json").read_text())
    said["policy"]["sha256"] = sha256(content)
    (folder / "summary.json").write_text(json.dumps(said))
    seal(folder)


def why(folder: Path, limits: Limits = Limits()) -> str:  # noqa: B008
    """Why an entry is refused."""
    verdict = verify_entry(folder, limits=limits)
    assert not verdict.accepted
    return "; ".join(verdict.problems)


def test_an_honest_entry_is_accepted(entry: Path) -> None:
    copied(entry, "mine")
    verdict = verify_entry(entry, announced_seed=1)
    assert verdict.problems == ()
    assert verdict.exact
    assert verdict.figures["claimed"] == verdict.figures["flown"]
    known, held_out = verdict.figures["flown"], verdict.figures["held_out"]
    assert known["count"] > 700
    assert abs(known["rate"] - held_out["rate"]) < 0.1


def test_held_out_goals_are_others() -> None:
    flown = fly(PROTOCOL, "random", (0,), announced=Announced("0" * 64, 1))
    assert flown.held_out is not None
    goals = [each.episodes["goal_azimuth_deg"] for each in (flown.evaluation, flown.held_out)]
    assert len(goals[0]) == len(goals[1])
    assert not goals[0].isin(goals[1]).any()


# Scores


def test_an_edited_score(entry: Path) -> None:
    path = entry / "summary.json"
    said = json.loads(path.read_text())
    count = said["success"]["count"]
    said["success"]["count"] = 999
    path.write_text(json.dumps(said))
    assert "summary.json has SHA-256" in why(entry)
    seal(entry)
    assert f"success.count: 999 is claimed, {count} follows from" in why(entry)


def test_a_summary_that_leaves_something_out(entry: Path) -> None:
    said = json.loads((entry / "summary.json").read_text())
    del said["success"]["rate"]
    (entry / "summary.json").write_text(json.dumps(said))
    seal(entry)
    assert "success.rate: 'nothing' is claimed" in why(entry)


def better(episodes: pd.DataFrame, flights: int) -> pd.DataFrame:
    """Some flights more that reach."""
    episodes = episodes.copy()
    failed = episodes.index[~episodes["success"]][:flights]
    episodes.loc[failed, "success"] = True
    episodes.loc[failed, "termination"] = "reach_target"
    return episodes


def test_a_score_edited_throughout(entry: Path) -> None:
    honest = read_evaluation(entry)
    claim(entry, better(honest.episodes, 30))
    seal(entry)
    count = honest.summary["success"]["count"]
    assert f"success.count: claimed {count + 30}, flown {count}" in why(entry)


@pytest.mark.parametrize(("flights", "accepted"), [(5, True), (6, False)])
def test_how_much_another_machine_may_differ(entry: Path, flights: int, accepted: bool) -> None:
    honest = read_evaluation(entry)
    claim(entry, better(honest.episodes, flights))
    claimed = read_evaluation(entry)
    assert (differences(claimed, honest, exact=False) == []) == accepted
    assert differences(claimed, honest, exact=True) != []


def test_shorter_flights_are_found_on_any_machine(entry: Path) -> None:
    honest = read_evaluation(entry)
    shorter = honest.episodes.assign(length_steps=honest.episodes["length_steps"] * 9 // 10)
    claim(entry, shorter)
    assert "mean length_steps" in " ".join(differences(read_evaluation(entry), honest, exact=False))


def test_goals_in_another_order(entry: Path) -> None:
    episodes = read_evaluation(entry).episodes
    claim(entry, episodes.iloc[::-1])
    seal(entry)
    assert "1,000 of 1,000 flights are not where the protocol's order has them" in why(entry)


def test_easier_goals(entry: Path) -> None:
    episodes = read_evaluation(entry).episodes
    claim(entry, episodes.assign(goal_azimuth_deg=episodes["goal_azimuth_deg"].clip(-10, 10)))
    seal(entry)
    assert "not where the protocol's order has them" in why(entry)


def test_a_protocol_that_was_another(entry: Path) -> None:
    seal(entry, lambda said: dataclasses.replace(said, protocol_sha256="0" * 64))
    assert f"here it has {named_protocol(PROTOCOL).hash}" in why(entry)


def test_seeds_that_were_not_run(root: Path) -> None:
    folder = root / PROTOCOL / "random"
    seal(folder, lambda said: dataclasses.replace(said, seeds=(0, 1)))
    assert "names seeds [0, 1]; its episodes are of seeds [0]" in why(folder)
    episodes = read_evaluation(folder).episodes
    said = json.loads((folder / "summary.json").read_text()) | {"seeds": [0, 1]}
    (folder / "summary.json").write_text(json.dumps(said))
    claim(folder, pd.concat([episodes, episodes.assign(seed=1)], ignore_index=True))
    seal(folder, lambda said: dataclasses.replace(said, seeds=(0, 1)))
    assert re.search(r"claimed \S+, flown \S+", why(folder))


# Policies


def test_swapped_weights(entry: Path) -> None:
    (entry / "policy.onnx").write_bytes(small_models.linear(small_models.weights(roll_gain=-1.0)))
    assert "policy.onnx has SHA-256" in why(entry)
    put_model(entry, (entry / "policy.onnx").read_bytes())
    assert "success.count: claimed" in why(entry)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (pickle.dumps(print), "no whole ONNX model"),
        (b"import socket; socket.create_connection(('example.org', 80))", "no whole ONNX model"),
        (small_models.with_external_data("../../../../etc/passwd"), "'../../../../etc/passwd'"),
        (small_models.with_foreign_operator(), "com.microsoft.Gelu"),
        (small_models.with_another_output(), "outputs must be action"),
        (small_models.with_nan(), "NaN at step"),
        (small_models.greedy(), "fails on a batch"),
    ],
    ids=["pickle", "python", "file system", "foreign", "outputs", "nan", "memory"],
)
def test_policies_that_are_more_or_less_than_policies(entry: Path, content: bytes, said: str) -> None:
    put_model(entry, content)
    assert said in why(entry)


def test_a_policy_without_end(entry: Path) -> None:
    put_model(entry, small_models.endless())
    assert "stopped after 5 s" in why(entry, Limits(wall_s=5.0))


@pytest.mark.slow
def test_a_policy_that_takes_all_of_the_processor(entry: Path) -> None:
    put_model(entry, small_models.endless())
    assert "processor time" in why(entry, Limits(processor_s=3))


def test_too_large_a_policy(entry: Path) -> None:
    put_model(entry, small_models.linear() + b"\0" * LARGEST_FILE)
    assert f"at most {LARGEST_FILE} are taken" in why(entry)


# Files


def test_links_lead_out(entry: Path, tmp_path: Path) -> None:
    for name in ("policy.onnx", "episodes.parquet", "summary.json", "submission.json"):
        (entry / name).rename(tmp_path / name)
        (entry / name).symlink_to(tmp_path / name)
        assert f"{name} is no plain file" in why(entry)
        (entry / name).unlink()
        (tmp_path / name).rename(entry / name)


def test_a_table_that_takes_all_memory(entry: Path, root: Path) -> None:
    """As many flights as there are goals, each of whose endings takes 20 MB; nor can it hide behind another entry."""
    path = entry / "episodes.parquet"
    table = pq.read_table(path)
    endless = pa.DictionaryArray.from_arrays(np.zeros(len(table), dtype=np.int32), ["x" * 20_000_000])
    table = table.set_column(table.column_names.index("termination"), "termination", endless)
    pq.write_table(table, path, compression="zstd", store_schema=False, dictionary_pagesize_limit=10**9)
    assert path.stat().st_size < 10**6
    seal(entry)
    assert "the claimed flights cannot be read: ArrowMemoryError" in why(entry)
    seal(root / PROTOCOL / "random", lambda said: dataclasses.replace(said, submitted="2999-01-01T00:00:00Z"))
    assert verify_entry(root / PROTOCOL / "random").accepted


def test_files_that_do_not_belong_there(entry: Path) -> None:
    (entry / "policy.py").write_text("print()")
    assert "does not belong there: policy.py" in why(entry)
    (entry / "policy.py").unlink()
    (entry / "episodes.parquet").unlink()
    assert "lacks episodes.parquet" in why(entry)


def test_an_entry_is_called_as_its_folder(entry: Path) -> None:
    moved = entry.rename(entry.with_name("elsewhere"))
    assert "must lie in normal-1k-v0/linear" in why(moved)


def test_episodes_that_are_none(entry: Path) -> None:
    episodes = pd.read_parquet(entry / "episodes.parquet")
    for content in (b"PAR1", b"", (entry / "episodes.parquet").read_bytes()[:-100]):
        (entry / "episodes.parquet").write_bytes(content)
        said = json.loads((entry / "submission.json").read_text())
        said["files"]["episodes.parquet"] = sha256(content)
        (entry / "submission.json").write_text(json.dumps(said, indent=2, ensure_ascii=False) + "\n")
        assert "is no Parquet file" in why(entry)
    claim(entry, episodes.astype({"success": "float64"}).assign(success=lambda frame: frame["success"] == 1, x=1))
    seal(entry)
    assert "a foreign column x" in why(entry)


# Names


def copied(entry: Path, name: str) -> Path:
    """The same entry under another name, later."""
    folder = Path(shutil.copytree(entry, entry.with_name(name)))
    seal(folder, lambda said: dataclasses.replace(said, author="Eve", submitted="2999-01-01T00:00:00Z"))
    return folder


def test_the_same_policy_under_another_name(entry: Path) -> None:
    folder = copied(entry, "mine")
    assert "the policy is that of entry normal-1k-v0/linear" in why(folder)


def test_the_same_flights_under_another_name(entry: Path) -> None:
    folder = copied(entry, "mine")
    disguised = onnx.ModelProto.FromString(small_models.linear())
    disguised.producer_name = "Eve"
    put_model(folder, disguised.SerializeToString())
    assert "the flights are those of entry normal-1k-v0/linear" in why(folder)


def test_flights_that_differ_a_little_are_the_same(entry: Path) -> None:
    flights = read_evaluation(entry).episodes
    reached = flights.index[flights["success"]]
    for share, same in ((0.04, True), (0.06, False)):
        other = flights.copy()
        other.loc[reached[: round(share * len(reached))], "length_steps"] += 1
        assert same_flights(flights, other) == same
    assert not same_flights(*[flights.assign(success=flights.index < 9)] * 2)  # too few to tell


def test_a_copy_cannot_be_submitted(root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "mine.onnx").write_bytes(small_models.linear())
    arguments = ["leaderboard", "submit", "--policy", str(tmp_path / "mine.onnx"), "--protocol", PROTOCOL]
    arguments += ["--author", "Eve", "--method", "Mine.", "--output", str(root)]
    before = sorted(root.rglob("*"))
    assert main(arguments) == 2
    assert "the policy is that of entry normal-1k-v0/linear" in capsys.readouterr().err
    assert main([*arguments, "--entry", "linear"]) == 2
    assert "entries are not overwritten" in capsys.readouterr().err
    assert main([*arguments, "--entry", "../linear"]) == 2
    assert "entry must be a name" in capsys.readouterr().err
    assert sorted(root.rglob("*")) == before


def test_what_is_refused_is_not_written(root: Path, tmp_path: Path) -> None:
    (tmp_path / "bad.onnx").write_bytes(small_models.with_nan())
    with pytest.raises(ValueError, match="NaN at step"):
        submit(root, str(tmp_path / "bad.onnx"), PROTOCOL, ADA)
    with pytest.raises(ValueError, match=r"ONNX model .* or one of"):
        submit(root, "module:factory", PROTOCOL, ADA)
    assert sorted(path.name for path in root.iterdir()) == [PROTOCOL]
    assert sorted(path.name for path in (root / PROTOCOL).iterdir()) == ["linear", "random"]


def test_errata_and_tables(root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "linear.onnx").write_bytes(small_models.linear())
    about = dataclasses.replace(
        ADA, entry="linear-2", author="<b>|[Ada](x)", supersedes=Erratum("linear", "the author's name")
    )
    folder = submit(root, str(tmp_path / "linear.onnx"), PROTOCOL, about)
    assert read_entry(folder).submission.supersedes == Erratum("linear", "the author's name")
    assert main(["leaderboard", "verify", str(folder), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)[0]["accepted"]

    rendering = ["leaderboard", "render", "--leaderboards", str(root)]
    assert main([*rendering, "--check"]) == 1
    assert not (root / "README.md").exists()
    assert main(rendering) == 0
    assert main([*rendering, "--check"]) == 0
    table, page = (root / "README.md").read_text(), (root / "site" / "index.html").read_text()
    assert "| 1 | [linear-2](normal-1k-v0/linear-2/submission.json) |" in table
    assert "| 2 | [random](normal-1k-v0/random/submission.json) |" in table
    assert "superseded: [linear](normal-1k-v0/linear/submission.json)" in table
    assert "&#60;b&#62;&#124;&#91;Ada&#93;&#40;x&#41;" in table
    assert "&lt;b&gt;|[Ada](x)" in page
    assert "<b>|" not in page


@pytest.fixture(scope="module")
def page(made: Path) -> str:
    return page_text(standings(made))


@pytest.mark.parametrize(("width", "dark"), [(360, True), (1280, False)])
def test_a_browser_lays_the_page_out(page: str, tmp_path: Path, width: int, dark: bool) -> None:
    found = laid_out(page, width, tmp_path, dark=dark)
    assert found["scroll"] <= width
    assert found["outside"] == []


@pytest.mark.parametrize(("clicks", "order"), [(0, "linear random"), (1, "random linear"), (2, "linear random")])
def test_a_browser_sorts_the_tables(page: str, tmp_path: Path, clicks: int, order: str) -> None:
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        pytest.skip(f"sorting tables takes a browser: one of {', '.join(BROWSERS)}")
    click = "document.querySelectorAll('th button')[2].click();" * clicks
    place = tmp_path / "page.html"
    place.write_text(page.replace("</body>", f"<script>{click}</script></body>"), encoding="utf-8")
    command = [browser, "--headless", "--no-sandbox", "--disable-gpu", "--dump-dom"]
    command += [f"--user-data-dir={tmp_path / 'profile'}", place.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    assert " ".join(re.findall(r"<th scope=\"row\"><a[^>]*>(\w+)</a>", done.stdout)) == order


def test_refusals_have_an_exit_code(root: Path, entry: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (entry / "policy.onnx").unlink()
    assert main(["leaderboard", "verify", str(entry)]) == 1
    assert "normal-1k-v0/linear: REFUSED\n  " in capsys.readouterr().out
    assert main(["leaderboard", "verify", str(root / "nothing")]) == 2
    assert main(["leaderboard", "verify"]) == 2
