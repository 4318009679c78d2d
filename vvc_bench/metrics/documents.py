"""Measures as JSON documents."""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

_DIGITS = 9
"""As many as do not depend on the order in which a processor adds."""


def plain(value: object) -> Any:
    """A measure as numbers, strings, lists and dicts: named fields by name, NaN as None, floats to nine digits.

    Raises:
        TypeError: for anything that has no such form.
    """
    if isinstance(value, np.generic | np.ndarray):
        return plain(value.tolist())
    if isinstance(value, float):
        return float(f"{value:.{_DIGITS}g}") if math.isfinite(value) else None
    if value is None or isinstance(value, str | int):
        return value
    if isinstance(value, Mapping):
        return {str(name): plain(part) for name, part in value.items()}
    if isinstance(value, tuple) and hasattr(value, "_asdict"):
        return plain(value._asdict())
    if dataclasses.is_dataclass(value):
        return {field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, tuple | list):
        return [plain(part) for part in value]
    raise TypeError(f"{type(value).__name__} has no form as JSON")
