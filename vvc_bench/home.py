"""Where this machine keeps what can be made or fetched again: compiled code and datasets."""

import os
from pathlib import Path

import platformdirs


def home_folder() -> Path:
    """``VVC_BENCH_HOME``, or the platform's cache folder."""
    home = os.environ.get("VVC_BENCH_HOME")
    return Path(home) if home else platformdirs.user_cache_path("vvc-bench", appauthor=False)
