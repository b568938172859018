"""Standard output for what a command prints alone: the middleware logs into it, too."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def middleware_to_stderr() -> Iterator[None]:
    """Standard output goes to standard error within, but for what is printed.

    Fast DDS writes its errors to standard output, such as of a shared memory file that a node left behind when it was
    killed: who reads a table or JSON there would read these, too.
    """
    out = sys.stdout
    try:
        out.flush()
        number = out.fileno()
    except (AttributeError, OSError, ValueError):  # not a file: nothing but Python writes there
        yield
        return
    own = os.dup(number)
    with os.fdopen(own, "w", encoding=out.encoding, errors=out.errors, buffering=1) as sys.stdout:
        os.dup2(sys.stderr.fileno(), number)
        try:
            yield
        finally:
            sys.stdout.flush()
            os.dup2(own, number)
            sys.stdout = out
