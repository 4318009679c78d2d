"""The quantities of the simulator as tables, made from their definitions.

python docs/figures/fields_table.py           # rewrite the tables of docs/reference-aircraft.md
python docs/figures/fields_table.py --check   # exit with 1 if the page is stale
"""

import argparse
import math
import sys

from figure_tools import DOCS, report, table, with_tables

from vvc_bench import sim
from vvc_bench.sim.fields import Field

PAGE = "reference-aircraft.md"
CLASSES = (sim.State, sim.GuidanceCommand, sim.SurfaceCommand, sim.Conditions)


def bounds(field: Field) -> str:
    """In the unit of the column's name."""
    low, high = (f"{value * field.unit.scale:.6g}" for value in (field.low, field.high))
    if math.isinf(field.low) and math.isinf(field.high):
        return ""
    if math.isinf(field.high):
        return f"≥ {low}"
    return f"{low} to {high}".replace("-", "−")


def field_table(quantities: type[tuple[float, ...]]) -> str:
    rows = [
        [
            f"`{name}`",
            field.symbol,
            field.meaning,
            field.unit.inside,
            bounds(field),
            "changes sign" if field.mirror < 0 else "",
        ]
        for name, field in sim.columns(quantities).items()
    ]
    return table(["column", "symbol", "meaning", "unit inside", "bounds", "mirrored"], rows, numbers=False)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="write nothing; exit with 1 if the page is stale")
    check = parser.parse_args().check
    tables = {quantities.__name__: field_table(quantities) for quantities in CLASSES}
    if not check:
        report(PAGE, tables)
        return
    page = (DOCS / PAGE).read_text(encoding="utf-8")
    if with_tables(page, tables) != page:
        sys.exit(f"docs/{PAGE} is stale: run python docs/figures/fields_table.py")


if __name__ == "__main__":
    main()
