"""What a process holds, by the kernel: :class:`Held`."""

from __future__ import annotations

import os
from pathlib import Path
from typing import NamedTuple


class Held(NamedTuple):
    """What a process holds."""

    memory_kb: int
    threads: int
    files: int
    cpu: float  # s, used so far

    @classmethod
    def by(cls, pid: int) -> Held:
        """From /proc."""
        proc = Path("/proc", str(pid))
        line = next(line for line in (proc / "status").read_text().splitlines() if line.startswith("VmRSS"))
        used = sum(map(int, (proc / "stat").read_text().rsplit(")", 1)[1].split()[11:13])) / os.sysconf("SC_CLK_TCK")
        return cls(int(line.split()[1]), len(list((proc / "task").iterdir())), len(list((proc / "fd").iterdir())), used)
