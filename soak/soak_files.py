"""Files that cannot be trusted: whatever is in one, or in its place, it is read, or refused with a CableShapeError.

Each kind is tried in a process of its own, with bounds on its memory, so that a crash below Python is seen, too. First
come devices, FIFOs, sockets, folders and links in the file's place, then bombs, then mutations of both.
"""

from __future__ import annotations

import faulthandler
import random
import resource
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from time import monotonic

from soak_kinds import NO_FILES, READERS, bombs, read, removed, sound

HANGS_S = 30.0  # one file that takes longer hangs
MEMORY = 4 << 30  # bytes, of the data of one process
TOKENS = (b"nan", b".inf", b"-1", b"1e308", b"0", b"[]", b"{}", b"null", b"&a", b"*a", b"!!python/object:os.system",
          b"\xff\xff\xff\xff", b"\x00" * 8, b"<", b'"', b": ", b"\n  - ", b"../" * 9, b"<<: *a", b"1:30", b"9" * 99,
          b"/dev/zero", b"~x/")  # fmt: skip


def mutated(content: bytes, chance: random.Random) -> bytes:
    """Some bytes changed, cut out, doubled or put in."""
    out = bytearray(content)
    for _ in range(chance.choice((1, 1, 2, 4, 16))):
        at = chance.randrange(len(out) + 1)
        length = min(chance.choice((1, 2, 4, 8, 64, 1024)), len(out) - at)
        kind = chance.randrange(6)
        if kind == 0 and length:
            out[at] ^= 1 << chance.randrange(8)
        elif kind == 1:
            del out[at : at + length]
        elif kind == 2:
            out[at:at] = out[at : at + length]
        elif kind == 3:
            out[at : at + length] = chance.randbytes(length)
        elif kind == 4:
            out[at:at] = chance.choice(TOKENS)
        else:
            del out[chance.randrange(len(out) + 1) :]
    return bytes(out)


def one_kind(kind: str, seconds: float, seed: int, folder: Path) -> int:
    """Mutates and reads for so long; how many. The file of the moment stays in `folder` if the process dies."""
    chance = random.Random(f"{kind} {seed}")
    _, most = resource.getrlimit(resource.RLIMIT_DATA)
    file = folder / f"mutated.{kind}"
    given = sound(kind, folder)
    for content in given:
        file.write_bytes(content)
        read(kind, file)  # loads what is needed
    resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, most))

    def watched() -> None:
        faulthandler.dump_traceback_later(HANGS_S, exit=True)
        read(kind, file)
        faulthandler.cancel_dump_traceback_later()

    for name, put in NO_FILES.items():
        print(f"{kind}: {name}", file=sys.stderr, flush=True)  # the last line, if this is the end
        removed(file)
        put(file)
        watched()
    removed(file)
    given += bombs(kind)
    for content in given:
        file.write_bytes(content)
        watched()
    until, count = monotonic() + seconds, len(given)
    while monotonic() < until:
        file.write_bytes(mutated(chance.choice(given), chance))
        watched()
        count += 1
    return count + len(NO_FILES)


def mutate(seconds: float, seed: int) -> list[str]:
    """All kinds in turn; what went wrong."""
    wrong = []
    for kind in READERS:
        with tempfile.TemporaryDirectory(prefix="soak_") as folder:
            share = seconds / len(READERS)
            command = [sys.executable, __file__, kind, str(share), str(seed), folder]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            print(f"{kind}: {done.stdout.strip() or 'nothing'} files damaged, exit code {done.returncode}")
            if done.returncode:
                last = Path(folder, f"mutated.{kind}")
                kept = Path(tempfile.gettempdir(), f"soak_files_{kind}_{seed}.{kind}")
                # else the last line says what it was
                if last.is_file() and not last.is_symlink() and last.stat().st_size <= MEMORY:
                    shutil.copyfile(last, kept)
                wrong.append(f"{kind}: exit code {done.returncode}, the file is {kept}\n{done.stderr[-3000:]}")
    return wrong


if __name__ == "__main__":
    kind_, seconds_, seed_, folder_ = sys.argv[1:]
    print(one_kind(kind_, float(seconds_), int(seed_), Path(folder_)))
