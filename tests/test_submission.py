"""What a submission may say and what a model may hold, before anything flies."""

import dataclasses
import json
from pathlib import Path

import pytest
import small_models

from vvc_bench.leaderboard.model import check_model
from vvc_bench.leaderboard.submission import (
    BuiltInPolicy,
    Erratum,
    OnnxPolicy,
    Submission,
    TrainingData,
    parse_submission,
)
from vvc_bench.policies.onnx import LARGEST_FILE

HONEST = Submission(
    entry="linear-v2",
    protocol="normal-1k-v0",
    protocol_sha256="a" * 64,
    author="Ada",
    method="A law linear in observation and goal.",
    training_data=(TrainingData("pid-v0", "b" * 64), TrainingData("our flights", None)),
    budget="one hour on two cores",
    code="https://example.org/linear",
    policy=OnnxPolicy("c" * 64, 1000),
    seeds=(0, 1),
    files={"summary.json": "d" * 64, "episodes.parquet": "e" * 64},
    submitted="2026-11-21T12:00:00Z",
    supersedes=Erratum("linear", "a wrong sign"),
    platform={"machine": "x86_64"},
)
PLACE = Path("submission.json")


@pytest.mark.parametrize(
    "submission", [HONEST, dataclasses.replace(HONEST, policy=BuiltInPolicy("pid"), supersedes=None, code=None)]
)
def test_a_submission_reads_back(submission: Submission) -> None:
    assert parse_submission(submission.to_bytes(), PLACE) == submission


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"entry": "../linear"}, "entry must be a name"),
        ({"entry": ".."}, "entry must be a name"),
        ({"entry": "Linear"}, "entry must be a name"),
        ({"protocol": "normal/1k"}, "protocol must be a name"),
        ({"protocol_sha256": "A" * 64}, "SHA-256"),
        ({"author": ""}, "author must be a text"),
        ({"author": "Ada\nLovelace"}, "one line"),
        ({"author": "\u202eadA"}, "one line"),
        ({"method": "x" * 501}, "1 to 500"),
        ({"code": "javascript:alert(1)"}, "URL"),
        ({"code": "https://example.org/)[x](y"}, "URL"),
        ({"policy": {"kind": "onnx", "file": "../pid/policy.onnx", "sha256": "c" * 64, "bytes": 1}}, "'file'"),
        ({"policy": {"kind": "python", "name": "module:factory"}}, "what executes code is not taken"),
        ({"policy": {"kind": "built-in", "name": "pid2"}}, "one of pid, "),
        ({"policy": "pid"}, "kind"),
        ({"seeds": []}, "list of 1"),
        ({"seeds": [0, 0]}, "different"),
        ({"seeds": [True]}, "whole number"),
        ({"seeds": [-1]}, "whole number"),
        ({"files": {"summary.json": "d" * 64}}, "lacks 'episodes.parquet'"),
        ({"files": {"summary.json": "d" * 64, "episodes.parquet": "e" * 64, "run.py": "e" * 64}}, "'run.py'"),
        ({"submitted": "yesterday"}, "time"),
        ({"supersedes": {"entry": "linear"}}, "lacks 'reason'"),
        ({"rank": 1}, "unknown entry 'rank'"),
        ({"format_version": 2}, "format_version must be 1"),
        ({"platform": {}}, "1 to 20"),
    ],
)
def test_anything_else_is_refused(changed: dict[str, object], said: str) -> None:
    document = json.loads(HONEST.to_bytes()) | changed
    with pytest.raises(ValueError, match=r"submission\.json: ") as refusal:
        parse_submission(json.dumps(document, indent=2).encode(), PLACE)
    assert said in str(refusal.value)


def test_every_entry_is_needed() -> None:
    document = json.loads(HONEST.to_bytes())
    for name in document:
        rest = {key: value for key, value in document.items() if key != name}
        with pytest.raises(ValueError, match=f"lacks '{name}'"):
            parse_submission(json.dumps(rest).encode(), PLACE)


def test_a_name_that_occurs_again_is_refused() -> None:
    content = HONEST.to_bytes().replace(b'"author": "Ada"', b'"author": "Eve",\n  "author": "Ada"')
    with pytest.raises(ValueError, match="not as vvc-bench leaderboard submit writes it"):
        parse_submission(content, PLACE)


@pytest.mark.parametrize("content", [b"", b"\xff", b"[]", b"[" * 100_000, b'"x"' + b" " * 10**6])
def test_no_document_is_refused(content: bytes) -> None:
    with pytest.raises(ValueError, match=r"submission\.json"):
        parse_submission(content, PLACE)


def test_a_model_of_standard_operators_is_taken() -> None:
    check_model(small_models.linear())
    check_model(small_models.endless())  # looking through a model takes no time; flying it has a limit


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "no whole ONNX model"),
        (b"import os", "no whole ONNX model"),
        (small_models.linear()[:-40], "no whole ONNX model"),
        (b"\0" * (LARGEST_FILE + 1), "at most"),
        (small_models.with_external_data("../../../etc/passwd"), "'../../../etc/passwd'"),
        (small_models.with_hidden_external_data("/etc/passwd"), "'/etc/passwd'"),
        (small_models.with_foreign_operator(), "com.microsoft.Gelu"),
        (small_models.with_function(), "functions"),
        (small_models.with_random_numbers(), "RandomNormalLike"),
    ],
    ids=["empty", "python", "cut", "large", "external", "hidden", "foreign", "function", "random"],
)
def test_any_other_model_is_refused(content: bytes, said: str) -> None:
    with pytest.raises(ValueError, match=r"model|tensor") as refusal:
        check_model(content)
    assert said in str(refusal.value)
