"""Reports: whole, self-contained, the same every time, right, and laid out by a real browser."""

import hashlib
import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest

if importlib.util.find_spec("matplotlib") is None:
    pytest.skip("reports take matplotlib", allow_module_level=True)

from html_page import Page, assert_self_contained, laid_out
from small_evaluations import made_up

from vvc_bench.cli import main
from vvc_bench.evaluation import Evaluation, evaluate, named_protocol
from vvc_bench.evaluation.methods import gather
from vvc_bench.evaluation.report import p_text, report_page, write_report
from vvc_bench.evaluation.samples import SAMPLES, flown_protocols, sample_flights
from vvc_bench.policies import open_agent

PROTOCOL = "normal-1k-v0"
PHONE, DESK = 360, 1280


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Real evaluations of built-in policies."""
    place = tmp_path_factory.mktemp("evaluations")
    for name, seeds in (("pid", (0,)), ("random", (0, 1))):
        evaluate(open_agent(name), named_protocol(PROTOCOL), seeds=seeds).write(place / name)
    return place


@pytest.fixture(scope="module")
def report(folders: Path) -> str:
    """The page that the command writes."""
    output = folders / "pages" / "report.html"
    assert main(["report", str(folders / "pid"), str(folders / "random"), "--output", str(output)]) == 0
    return output.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def page(report: str) -> Page:
    return Page(report)


def test_the_page_needs_nothing_else(report: str, page: Page) -> None:
    assert_self_contained(report, page)
    assert {"name": "viewport", "content": "width=device-width, initial-scale=1"} in page.all("meta")
    pictures = page.all("img")
    # Ranks; soon, endings, near; a map each and along; who wins where; in space and how they come, each.
    assert len(pictures) == len(page.all("source")) == 1 + 3 + 3 + 1 + 4
    assert all(len(picture["alt"]) > 20 for picture in pictures)


@pytest.mark.parametrize(("width", "dark"), [(PHONE, False), (PHONE, True), (DESK, False)])
def test_a_browser_lays_it_out(report: str, tmp_path: Path, width: int, dark: bool) -> None:
    found = laid_out(report, width, tmp_path, dark=dark)
    assert found["width"] == width
    assert found["scroll"] <= width
    assert found["outside"] == []
    assert found["background"] == ("rgb(14, 17, 22)" if dark else "rgb(245, 246, 248)")
    sizes = np.array(found["pictures"])
    assert (sizes[:, 0] > 0.75 * min(width, 512)).all()
    assert (sizes[:, 1] > 60).all()


def test_a_page_that_is_too_wide_is_found_out(report: str, tmp_path: Path) -> None:
    wide = report.replace("<main>", "<main><p style='width: 700px; max-width: none'>too wide</p>")
    found = laid_out(wide, PHONE, tmp_path)
    assert found["scroll"] > PHONE
    assert len(found["outside"]) == 1


def test_it_says_what_was_found(folders: Path, page: Page) -> None:
    first, second = (json.loads((folders / name / "summary.json").read_text()) for name in ("pid", "random"))
    for figure in (
        PROTOCOL,
        first["protocol"]["hash"],
        f"{100 * first['success']['rate']:.2f}",
        f"{100 * first['success']['low']:.1f}–{100 * first['success']['high']:.1f}",
        f"{100 * second['success']['rate']:.2f}",
        f"{first['speed_error_mps']['mean']:.2f} ± {first['speed_error_mps']['std']:.2f}",
        "pid – random",
        "< 0.0001",
        "2 seeds",
        "pid (built-in)",
    ):
        assert figure in page.text, figure
    assert "not shown" not in page.text


def test_names_are_text_and_missing_policies_are_said() -> None:
    """And nothing but the evaluations decides the bytes."""
    hostile = "<script>alert(1)</script> $a_$"
    methods = gather([(hostile, made_up(hostile, 0.0, protocol=PROTOCOL))])
    text = report_page(methods, {PROTOCOL: named_protocol(PROTOCOL)}, {})
    assert report_page(methods, {PROTOCOL: named_protocol(PROTOCOL)}, {}) == text
    page = Page(text)
    assert_self_contained(text, page)
    assert hostile in page.text
    assert "not shown; its policy is not at hand" in page.text


def test_sample_flights_are_those_that_were_evaluated() -> None:
    evaluation = evaluate(open_agent("pid"), named_protocol(PROTOCOL))
    methods = gather([("pid", evaluation)])
    protocols = flown_protocols(methods)
    flights = sample_flights(methods, protocols)[PROTOCOL, "pid"]
    assert len(flights) == SAMPLES
    goals = protocols[PROTOCOL].goals
    places = [int(np.flatnonzero((goals == goal).all(axis=1))[0]) for goal in flights.goals]
    rows = evaluation.episodes.iloc[places]
    np.testing.assert_array_equal(flights.lengths, rows["length_steps"])
    np.testing.assert_array_equal(flights.reached, rows["success"])
    assert sample_flights(gather([("a", made_up("a", 0.5, protocol=PROTOCOL))]), protocols) == {}


def write_level_flight(path: Path) -> Path:
    """An ONNX policy that always commands wings level, 1 g and half throttle."""
    onnx = pytest.importorskip("onnx", reason="making an ONNX file takes onnx")
    pytest.importorskip("onnxruntime", reason="flying an ONNX file takes onnxruntime")
    helper = onnx.helper
    inputs = [
        helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, ["B", width])
        for name, width in (("observation", 8), ("desired_goal", 3))
    ]
    outputs = [helper.make_tensor_value_info("action", onnx.TensorProto.FLOAT, ["B", 3])]
    weights = onnx.numpy_helper.from_array(np.zeros((8, 3), dtype=np.float32), "weights")
    bias = onnx.numpy_helper.from_array(np.array([0.0, 1.0, 0.5], dtype=np.float32), "bias")
    node = helper.make_node("Gemm", ["observation", "weights", "bias"], ["action"])
    graph = helper.make_graph([node], "level", inputs, outputs, [weights, bias])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    path.write_bytes(model.SerializeToString())
    return path


def test_a_policy_is_known_by_its_checksum(tmp_path: Path) -> None:
    """A file that no evaluation names is not even opened."""
    stranger = tmp_path / "stranger.onnx"
    stranger.write_bytes(b"no policy")
    level = write_level_flight(tmp_path / "level.onnx")
    evaluation = made_up("level", 0.0, protocol=PROTOCOL)
    evaluation.summary["policy"]["sha256"] = hashlib.sha256(level.read_bytes()).hexdigest()
    methods = gather([("level", evaluation), ("other", made_up("other", 0.5, protocol=PROTOCOL))])
    flights = sample_flights(methods, {PROTOCOL: named_protocol(PROTOCOL)}, [stranger, level])
    assert list(flights) == [(PROTOCOL, "level")]
    assert (flights[PROTOCOL, "level"].actions == np.array([0.0, 1.0, 0.5], dtype=np.float32)).all()
    with pytest.raises(FileNotFoundError, match="no policy file"):
        sample_flights(methods, {PROTOCOL: named_protocol(PROTOCOL)}, [tmp_path / "nowhere.onnx"])


def test_protocols_that_have_changed_are_refused() -> None:
    old: Evaluation = made_up("old", 0.5, protocol=PROTOCOL)
    with pytest.raises(ValueError, match="was another protocol when it was flown"):
        flown_protocols(gather([("old", old)]))


def test_a_failure_leaves_the_older_page(tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    path.write_text("older")
    with pytest.raises(ValueError, match="at least one evaluation"):
        write_report(path, (), {})
    assert path.read_text() == "older"


def test_small_p_values_are_bounds() -> None:
    assert p_text(0.034567) == "0.035"
    assert p_text(1e-12) == "&lt; 0.0001"


# The commands


def test_compare_prints_and_writes(folders: Path, capsys: pytest.CaptureFixture[str]) -> None:
    places = [str(folders / "random"), f"law={folders / 'pid'}"]
    assert main(["compare", *places]) == 0
    text = capsys.readouterr().out
    assert "law – random" in text
    assert main(["compare", *places, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert [contender["label"] for contender in document["contenders"]] == ["law", "random"]
    assert document["pairs"][0]["better"] == "law"
    assert document["protocol"]["name"] == PROTOCOL


def test_bad_input_is_said_on_one_line(folders: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pid = str(folders / "pid")
    for arguments, text in (
        (["compare", pid], "takes two or more"),
        (["compare", pid, pid], "two folders called pid"),
        (["compare", f"a={pid}", f"a={pid}"], "holds the policy pid twice"),
        (["compare", pid, str(tmp_path / "nowhere")], "holds no evaluation"),
        (["report", pid, "--output", str(folders / "pid" / "summary.json" / "page.html")], "cannot write"),
    ):
        assert main(arguments) == 2, arguments
        captured = capsys.readouterr()
        assert text in captured.err, captured.err
        assert captured.err.count("\n") == 1
        assert captured.out == ""


def test_a_folder_may_have_an_equals_sign(folders: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    place = tmp_path / "rate=0.1"
    place.symlink_to(folders / "pid")
    assert main(["compare", str(place), f"b={folders / 'random'}", "--json"]) == 0
    assert [contender["label"] for contender in json.loads(capsys.readouterr().out)["contenders"]] == ["pid", "b"]
