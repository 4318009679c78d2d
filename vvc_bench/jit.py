"""The only door to the compiler.

Kernels are plain Python functions of floats and NamedTuples. Numba compiles them; with ``VVC_BENCH_JIT=0`` in the
environment they run as they are, slowly, and give the same bits.

Numba's own cache looks only at the file of the function it stores, so a compiled entry point would be served stale
after an edit to a kernel that it calls from another file, or to a table. Here the cache folder is named by a hash of
everything that the machine code is made of.
"""

import functools
import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

from vvc_bench.home import home_folder

Function = TypeVar("Function", bound=Callable[..., object])

COMPILED = os.environ.get("VVC_BENCH_JIT", "1") != "0"
"""Whether kernels are compiled in this process; the environment variable ``VVC_BENCH_JIT=0`` says no."""

_PACKAGE = Path(__file__).parent


def source_hash() -> str:
    """Hash of every source and data file of the package: what compiled code depends on."""
    digest = hashlib.sha256()
    for path in sorted(_PACKAGE.rglob("*")):
        if path.suffix in {".py", ".csv", ".json"}:
            digest.update(str(path.relative_to(_PACKAGE)).encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


@functools.cache
def cache_folder() -> Path:
    """Where this version's compiled code is kept (``VVC_BENCH_HOME``/compiled, or the platform's cache folder)."""
    return home_folder() / "compiled" / source_hash()


def _compile(function: Function, **options: object) -> Function:
    if not COMPILED:
        return function
    import numba

    return cast(Function, numba.njit(error_model="numpy", nogil=True, **options)(function))


def _is_writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(folder, os.W_OK)


def _plain_from_python(function: Function) -> Function:
    """Let Python's own calls run a compiled function's source, as they would with ``VVC_BENCH_JIT=0``.

    Numba would compile a wrapper for them, which costs seconds where states go in and out.
    """
    if COMPILED:
        cast(Any, function).__class__ = _plain_class(cast(Any, type(function)))
    return function


@functools.cache
def _plain_class(dispatcher: Any) -> type:
    def call(self: Any, *arguments: object) -> object:
        return self.py_func(*arguments)

    return type("Plain", (dispatcher,), {"__call__": call})


def inlined(function: Function) -> Function:
    """Compile as part of its one caller: for the long functions that a time step is made of."""
    return _plain_from_python(_compile(function, inline="always"))


def kernel(function: Function) -> Function:
    """Compile a function that entry points and other kernels call: no fast-math, IEEE division.

    The machine code is always inlined: passing a state's 42 fields by value costs more than the arithmetic.
    """
    return _plain_from_python(_compile(function, forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True))


def routine(function: Function) -> Function:
    """Compile once and call: for what is used in several places where speed does not matter."""
    return _plain_from_python(_compile(function, no_cpython_wrapper=True, no_cfunc_wrapper=True))


def entry_point(function: Function) -> Function:
    """Compile a function that Python calls; it releases the GIL, and its machine code is kept between processes."""
    if not COMPILED or not _is_writable(cache_folder()):
        return _compile(function)
    import numba

    users_folder = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = str(cache_folder())  # numba reads it while it decorates
    try:
        return _compile(function, cache=True)
    finally:
        numba.config.CACHE_DIR = users_folder
