"""Look-up in tables over uniform or irregular grids, clamped at their ends and safe for any input, NaN included."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vvc_bench.jit import kernel

_NODE_TOLERANCE = 1e-6  # bins; float32 nodes are that far off, which extrapolates a cell by as little


class Axis(NamedTuple):
    """One grid, prepared so that finding a cell takes no search.

    The nodes must be whole multiples of some step apart; ``cell_of_bin`` says for each step-wide bin which cell it
    lies in.
    """

    first: float
    last: float
    bins_per_unit: float
    cell_of_bin: NDArray[np.int64]
    node: NDArray[np.float64]
    per_width: NDArray[np.float64]


def make_axis(nodes: ArrayLike, bin_width: float) -> Axis:
    """Prepare a grid of at least two ascending nodes, whole multiples of ``bin_width`` apart.

    Raises:
        ValueError: if the nodes do not ascend, or do not lie on bin edges.
    """
    node = np.asarray(nodes, dtype=np.float64)
    edges = (node - node[0]) / bin_width
    if node.size < 2 or np.any(np.diff(node) <= 0) or np.any(np.abs(edges - np.round(edges)) > _NODE_TOLERANCE):
        raise ValueError(f"grid nodes must ascend in whole multiples of {bin_width}, got {node.tolist()}")
    counts = np.round(np.diff(edges)).astype(np.int64)
    cell_of_bin = np.repeat(np.arange(node.size - 1), counts)
    cell_of_bin = np.append(cell_of_bin, node.size - 2)  # the last node itself
    return Axis(float(node[0]), float(node[-1]), 1.0 / bin_width, cell_of_bin, node, 1.0 / np.diff(node))


@kernel
def clip(value: float, low: float, high: float) -> float:
    """``value`` limited to [low, high]; NaN becomes ``low``, so that an index made from it is valid."""
    if not value > low:
        return low
    if value > high:
        return high
    return value


@kernel
def locate(axis: Axis, value: float) -> tuple[int, float]:
    """The cell that holds ``value`` (clamped to the grid) and the fraction of the way through it."""
    inside = clip(value, axis.first, axis.last)
    cell = axis.cell_of_bin[int((inside - axis.first) * axis.bins_per_unit)]
    return cell, (inside - axis.node[cell]) * axis.per_width[cell]


@kernel
def linear(table: NDArray[np.float64], cell: int, fraction: float) -> float:
    """Interpolate ``table[node]``."""
    low: float = table[cell]
    high: float = table[cell + 1]
    return low + fraction * (high - low)


@kernel
def bilinear(table: NDArray[np.float64], row: int, row_fraction: float, column: int, column_fraction: float) -> float:
    """Interpolate ``table[row, column]``."""
    low = linear(table[row], column, column_fraction)
    high = linear(table[row + 1], column, column_fraction)
    return low + row_fraction * (high - low)
