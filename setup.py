"""Build of the ament_python package `cable_shape`. Dependencies: package.xml (ROS) and requirements.txt (PyPI)."""

from pathlib import Path

from setuptools import find_packages, setup

NAME = "cable_shape"


def data_files() -> list[tuple[str, list[str]]]:
    """Everything that belongs under share/cable_shape: configuration and launch files."""
    files = sorted(p for top in ("config", "launch") for p in Path(top).rglob("*") if p.is_file())
    folders = sorted({p.parent for p in files if "__pycache__" not in p.parts})
    return [
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        *((f"share/{NAME}/{folder}", [str(p) for p in files if p.parent == folder]) for folder in folders),
    ]


setup(
    name=NAME,
    version="0.1.0",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed"]},
    data_files=data_files(),
    python_requires=">=3.11,<3.14",
    zip_safe=False,
    description="Predicts, every control cycle, the shape of the cable held between two grippers",
    maintainer="cable_shape maintainers",
    maintainer_email="maintainers@cable-shape.example",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            "cable-shape = cable_shape.cli:main",
            "cable_shape_node = cable_shape.ros.node:run",
        ],
    },
)
