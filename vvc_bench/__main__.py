"""``python -m vvc_bench`` is ``vvc-bench``."""

import sys

from vvc_bench.cli import main

sys.exit(main())
