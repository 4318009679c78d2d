"""Give up what flying a policy does not take, then run a module: a script of the standard library alone.

    python -P confinement.py '{"memory_bytes": …}' MODULE

It must run before anything else is imported: a process with threads cannot leave its network. What the system does not
offer is left out and named in the answer of `confine`; memory, processor time and file size are limited everywhere.

- Network: a namespace of its own, without interfaces (Linux user namespaces); on newer systems no TCP either.
- Files: Landlock (Linux 5.13). To be read: Python, its packages, system libraries; to be written: the working folder
  alone. No program can be started.
- Memory, processor seconds, size of a file: resource limits, which raise an error or end the process.
"""

import ctypes
import dataclasses
import json
import os
import resource
import runpy
import sys
from collections.abc import Iterable
from pathlib import Path

_NEW_USER, _NEW_NETWORK = 0x10000000, 0x40000000  # CLONE_NEWUSER, CLONE_NEWNET of Linux's sched.h
_NO_NEW_PRIVILEGES = 38  # PR_SET_NO_NEW_PRIVS of Linux's prctl.h

# Linux's landlock.h; the numbers of the calls are the same on all architectures that Python is built for.
_CREATE_RULESET, _ADD_RULE, _RESTRICT_SELF = 444, 445, 446
_VERSION = 1  # LANDLOCK_CREATE_RULESET_VERSION
_BENEATH = 1  # LANDLOCK_RULE_PATH_BENEATH
_READ_FILE, _LIST, _WRITE_FILE, _TRUNCATE = 1 << 2, 1 << 3, 1 << 1, 1 << 14
_CHANGE = _WRITE_FILE | 1 << 4 | 1 << 5 | 1 << 7 | 1 << 8  # remove folders and files, make folders and files
_RIGHTS = {1: 13, 2: 14, 3: 15, 4: 15, 5: 16}
"""How many rights over files each version of Landlock knows; later versions know as many as 5."""
_TCP, _TCP_SINCE = 0b11, 4  # bind and connect
_SCOPES, _SCOPES_SINCE = 0b11, 6  # abstract Unix sockets, signals to others

_SYSTEM = (
    *("/usr", "/lib", "/lib64", "/etc/ld.so.cache", "/etc/localtime"),
    *("/proc/self", "/proc/cpuinfo", "/proc/meminfo", "/proc/stat", "/sys/devices/system", "/dev/urandom"),
)
"""What Python and its packages read besides themselves."""


@dataclasses.dataclass(frozen=True)
class Limits:
    """What one process gets.

    Args:
        wall_s: seconds until it is killed, whatever it does.
        processor_s: processor seconds of all its threads.
        memory_bytes: address space. NumPy, Numba and onnxruntime alone take 2·10⁹ to 3·10⁹ bytes of it.
        file_bytes: of any file that it writes.
        tasks: threads and processes, where it has a namespace of its own.
    """

    wall_s: float = 900.0
    processor_s: int = 1800
    memory_bytes: int = 8 * 10**9
    file_bytes: int = 64 * 10**6
    tasks: int = 256


def confine(limits: Limits, readable: Iterable[Path]) -> dict[str, bool]:
    """Give up all rights but those that are needed, for good.

    Args:
        limits: what this process gets. The wall clock is its parent's business.
        readable: folders and files that may be read, besides the system's libraries; the working folder may be read
            and written.

    Returns:
        Whether this system could take away ``network`` and ``files``.
    """
    libc = ctypes.CDLL(None, use_errno=True)
    network = hasattr(libc, "unshare") and libc.unshare(_NEW_USER | _NEW_NETWORK) == 0
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    for kind, most in (
        (resource.RLIMIT_AS, limits.memory_bytes),
        (resource.RLIMIT_CPU, limits.processor_s),
        (resource.RLIMIT_FSIZE, limits.file_bytes),
        *([(resource.RLIMIT_NPROC, limits.tasks)] if network else []),  # elsewhere all of the user's would count
    ):
        _, hard = resource.getrlimit(kind)
        most = most if hard == resource.RLIM_INFINITY else min(most, hard)
        resource.setrlimit(kind, (most, most))
    files = sys.platform == "linux" and _restrict_files(libc, [*map(Path, _SYSTEM), *readable])
    return {"network": network, "files": files}


def _restrict_files(libc: ctypes.CDLL, readable: Iterable[Path]) -> bool:
    """Whether Landlock now restricts this process."""
    version = libc.syscall(_CREATE_RULESET, None, ctypes.c_size_t(0), _VERSION)
    if version < 1:
        return False
    handled = (1 << _RIGHTS[min(version, max(_RIGHTS))]) - 1
    parts = [handled, *([_TCP] if version >= _TCP_SINCE else []), *([_SCOPES] if version >= _SCOPES_SINCE else [])]
    asked = (ctypes.c_uint64 * len(parts))(*parts)
    rules = libc.syscall(_CREATE_RULESET, asked, ctypes.c_size_t(ctypes.sizeof(asked)), 0)
    if rules < 0:
        return False
    try:
        for path in readable:
            _allow(libc, rules, path, handled & (_READ_FILE | _LIST))
        _allow(libc, rules, Path("/dev/null"), handled & (_READ_FILE | _WRITE_FILE))
        _allow(libc, rules, Path.cwd(), handled & (_READ_FILE | _LIST | _CHANGE | _TRUNCATE))
        alone = libc.prctl(_NO_NEW_PRIVILEGES, *map(ctypes.c_ulong, (1, 0, 0, 0))) == 0
        return alone and bool(libc.syscall(_RESTRICT_SELF, rules, 0) == 0)
    finally:
        os.close(rules)


def _allow(libc: ctypes.CDLL, rules: int, path: Path, rights: int) -> None:
    """Allow something beneath a path, if there is such a path."""
    try:
        place = os.open(path, os.O_PATH | os.O_CLOEXEC)
    except OSError:
        return
    try:
        if not path.is_dir():
            rights &= ~_LIST
        rule = rights.to_bytes(8, sys.byteorder) + place.to_bytes(4, sys.byteorder)  # a packed struct
        if libc.syscall(_ADD_RULE, rules, _BENEATH, rule, 0) < 0:
            raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()), str(path))
    finally:
        os.close(place)


def _pythons_folders() -> set[Path]:
    """Where Python and its packages are."""
    return {Path(folder) for folder in (sys.prefix, sys.base_prefix, *filter(os.path.isdir, sys.path))}


if __name__ == "__main__":
    _limits, _module = sys.argv[1:]
    sys.argv = [_module, json.dumps(confine(Limits(**json.loads(_limits)), _pythons_folders()))]
    runpy.run_module(_module, run_name="__main__", alter_sys=True)
