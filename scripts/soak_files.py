"""Damaged files: whatever is in a YAML file, a URDF or a recording, it is read, or refused with a CableShapeError.

    scripts/soak --files 60                                     # mutations of the files that come along, for 60 s
    python scripts/soak_files.py KIND -max_total_time=60        # coverage-guided, where atheris is installed
    (KIND: yaml, urdf, mcap, db3)

Each kind is tried in a process of its own, so that a crash below Python is seen, too.
"""

from __future__ import annotations

import contextlib
import faulthandler
import random
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from time import monotonic

CONFIG = Path(__file__).resolve().parents[1] / "config"
HANGS_S = 60.0  # one file that takes longer hangs
TOKENS = (b"nan", b".inf", b"-1", b"1e308", b"0", b"[]", b"{}", b"null", b"&a", b"*a", b"!!python/object:os.system",
          b"\xff\xff\xff\xff", b"\x00" * 8, b"<", b'"', b": ", b"\n  - ", b"../" * 9)  # fmt: skip


def read_yaml(file: Path) -> None:
    """Every reader of YAML."""
    from cable_shape.cable import Cable
    from cable_shape.errors import CableShapeError
    from cable_shape.robot import Robot
    from cable_shape.ros.assembly import load_cables
    from cable_shape.scene import Scene

    for read in (Cable.from_yaml, Scene.from_yaml, load_cables, Robot.from_yaml):
        with contextlib.suppress(CableShapeError):
            read(file)


def read_urdf(file: Path) -> None:
    """The robot that a URDF describes, and where its links are."""
    from cable_shape.errors import CableShapeError
    from cable_shape.pose import Pose
    from cable_shape.robot import Gripper, Robot

    grippers = {side: Gripper(f"{side}_tool", Pose((0.0, 0.0, 0.0))) for side in ("left", "right")}
    with contextlib.suppress(CableShapeError):
        Robot(file, grippers).link_poses()


def read_bag(file: Path) -> None:
    """All messages of a recording."""
    from cable_shape.errors import CableShapeError
    from cable_shape.replay.bags import Bag

    with contextlib.suppress(CableShapeError), Bag(file) as bag:
        for _ in bag.messages(tuple(bag.types)):
            pass


READERS: dict[str, Callable[[Path], None]] = {
    "yaml": read_yaml,
    "urdf": read_urdf,
    "mcap": read_bag,
    "db3": read_bag,
}


def seeds(kind: str, folder: Path) -> list[bytes]:
    """Sound files of this kind."""
    if kind in ("yaml", "urdf"):
        return [file.read_bytes() for file in sorted(CONFIG.rglob(f"*.{kind}"))]
    from soak_replay import write_recording

    bag = folder / kind
    write_recording(bag, kind, 6)
    return [(bag / f"{kind}.{kind}").read_bytes()]


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
    sound = seeds(kind, folder)
    file = folder / f"mutated.{kind}"
    read = READERS[kind]
    for content in sound:
        file.write_bytes(content)
        read(file)
    until, count = monotonic() + seconds, 0
    while monotonic() < until:
        file.write_bytes(mutated(chance.choice(sound), chance))
        faulthandler.dump_traceback_later(HANGS_S, exit=True)
        read(file)
        faulthandler.cancel_dump_traceback_later()
        count += 1
    return count


def mutate(seconds: float, seed: int) -> list[str]:
    """All kinds in turn; what went wrong."""
    wrong = []
    for kind in READERS:
        with tempfile.TemporaryDirectory(prefix="soak_") as folder:
            share = seconds / len(READERS)
            command = [sys.executable, __file__, "--share", kind, str(share), str(seed), folder]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            print(f"{kind}: {done.stdout.strip() or 'nothing'} files damaged, exit code {done.returncode}")
            if done.returncode:
                kept = Path(tempfile.gettempdir(), f"soak_files_{kind}_{seed}.{kind}")
                kept.write_bytes(Path(folder, f"mutated.{kind}").read_bytes())
                wrong.append(f"{kind}: exit code {done.returncode}, the file is {kept}\n{done.stderr[-3000:]}")
    return wrong


def guided(kind: str, options: list[str]) -> None:
    """By atheris, which learns what bytes lead further into the readers."""
    import atheris

    # they are compiled, and must stay as they are
    kernels = [f"cable_shape.kernels.{file.stem}" for file in (CONFIG.parent / "cable_shape" / "kernels").glob("*.py")]
    folder = Path(tempfile.mkdtemp(prefix="soak_"))
    corpus = folder / "corpus"
    corpus.mkdir()
    file = folder / f"guided.{kind}"
    with atheris.instrument_imports(include=["cable_shape", "yaml", "rosbags"], exclude=kernels):
        for k, content in enumerate(seeds(kind, folder)):
            (corpus / str(k)).write_bytes(content)
            file.write_bytes(content)
            READERS[kind](file)

    def one(content: bytes) -> None:
        file.write_bytes(content)
        READERS[kind](file)

    atheris.Setup([sys.argv[0], *options, str(corpus)], one)
    atheris.Fuzz()


if __name__ == "__main__":
    if sys.argv[1] == "--share":
        kind_, seconds_, seed_, folder_ = sys.argv[2:]
        print(one_kind(kind_, float(seconds_), int(seed_), Path(folder_)))
    else:
        guided(sys.argv[1], sys.argv[2:])
