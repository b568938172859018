"""What pyproject.toml cannot say of the package: the files of a ROS prefix, for colcon and pip alike."""

from pathlib import Path

from setuptools import setup

NAME = "cable_shape"


def data_files() -> list[tuple[str, list[str]]]:
    """What belongs under share/cable_shape: configuration, launch files, and the messages, which replays write."""
    files = sorted(p for top in ("config", "launch") for p in Path(top).rglob("*") if p.is_file())
    folders = sorted({p.parent for p in files if "__pycache__" not in p.parts})
    return [
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/msg", sorted(str(p) for p in Path("msg_defs/msg").glob("*.msg"))),
        *((f"share/{NAME}/{folder}", [str(p) for p in files if p.parent == folder]) for folder in folders),
    ]


setup(
    name=NAME,
    data_files=data_files(),
    license="Apache-2.0",  # in pyproject.toml setuptools 68 and those from 77 on want it written in two ways
    python_requires=">=3.11,<3.14",  # from there colcon 0.21 cannot read it
    zip_safe=False,
)
