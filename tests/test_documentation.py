"""What README, docs and docstrings show must run."""

import doctest
import importlib
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
TRAIN = "pip install vvc-bench[train]"
"""A block that says so is tried where that is installed, and `make test-train` tries it: its id ends in ``train``."""
BLOCKS = [
    pytest.param(block, id=f"{page.stem}-{i}{'-train' * (TRAIN in block)}")
    for page in PAGES
    for i, block in enumerate(re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL))
]


@pytest.mark.parametrize("block", BLOCKS)
@pytest.mark.filterwarnings("ignore:.*precision lowered by casting:UserWarning")  # Gymnasium's own wrapper
def test_python_of_the_pages(block: str) -> None:
    if TRAIN in block:
        pytest.importorskip("stable_baselines3", reason=f"Stable-Baselines3 is not installed: {TRAIN}")
    exec(compile(block, "page", "exec"), {})


@pytest.mark.parametrize("module", ["vvc_bench.sim", "vvc_bench.experts", "vvc_bench.flight"])
def test_examples_of_docstrings(module: str) -> None:
    failed, tried = doctest.testmod(importlib.import_module(module))
    assert failed == 0
    assert tried > 0


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_links_of_the_pages_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#\s]+)", page.read_text(encoding="utf-8")):
        assert target.startswith("http") or (page.parent / target).exists(), target
