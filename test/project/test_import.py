"""What `import cable_shape` may load, and how what it exports is guarded."""

import ast
import importlib
import json
import subprocess
import sys
from pathlib import Path

import pytest

import cable_shape as cs

HEAVY = (
    "rclpy",
    "rerun",
    "fcl",
    "pinocchio",
    "mink",
    "mujoco",
    "ompl",
    "matplotlib",
    "rosbags",
    "tqdm",
)


def test_import_loads_no_numerics_before_they_are_used() -> None:
    code = (
        "import json, sys, cable_shape; print(json.dumps([m for m in ('numpy', 'numba', 'scipy') if m in sys.modules]))"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120)
    assert json.loads(out.stdout) == []


def test_a_cycle_loads_neither_batches_nor_trajectories_nor_calibration() -> None:
    code = """
import json, sys
import cable_shape as cs
cs.Cable, cs.Scene, cs.Grip, cs.Cycle, cs.Predictor, cs.predict
from cable_shape.warm_up import warm_up_cycles
parts = ("planning.batch", "planning.trajectory", "planning.paths", "calibration.fit", "uncertainty.calibrated_tube")
print(json.dumps([part for part in parts if f"cable_shape.{part}" in sys.modules]))
"""
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=300)
    assert json.loads(out.stdout) == []


def test_types_are_checked_on_the_names_that_are_loaded() -> None:
    """What the type checker reads under TYPE_CHECKING is what is loaded at first use, and all of __all__."""
    tree = ast.parse(Path(cs.__file__).read_text(encoding="utf-8"))
    block = next(node for node in tree.body if isinstance(node, ast.If))
    read = {alias.name: node.module for node in block.body for alias in node.names}  # type: ignore[attr-defined]
    assert {name: f"cable_shape.{module}" for name, module in cs._MODULES.items()} == read
    assert {*read, "warm_up"} == {*cs.__all__}
    assert {*cs.__all__} <= {*dir(cs)}
    with pytest.raises(AttributeError, match="no attribute 'predikt'"):
        cs.predikt  # noqa: B018


def test_import_leaves_heavy_libraries_out() -> None:
    code = f"import json, sys, cable_shape; print(json.dumps([m for m in {HEAVY!r} if m in sys.modules]))"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120)
    assert json.loads(out.stdout) == [], "import cable_shape loads libraries that only some uses need"


def test_cycle_without_meshes_needs_no_heavy_library() -> None:
    code = f"""
import json, sys
import cable_shape as cs
cable = cs.Cable(1.0, 0.1, 0.01)
scene = cs.Scene(obstacles=[cs.Obstacle("post", cs.Cylinder(0.03, 0.4), cs.Pose((0.4, 0, 0)))])
q = (0.5, 0.5, 0.5, 0.5)
grips = {{"cable": (cs.Pose((0, 0, 0.5), q), cs.Pose((0.8, 0, 0.5), q))}}
report = cs.Cycle(cable, model="gradient4", scene=scene).step(grips, 0)
assert report.shapes["cable"].status
print(json.dumps([m for m in {HEAVY!r} if m in sys.modules]))
"""
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=300)
    assert json.loads(out.stdout) == []


def test_every_export_exists_and_is_sorted() -> None:
    assert list(cs.__all__) == sorted(cs.__all__)
    for name in cs.__all__:
        assert hasattr(cs, name), f"cable_shape.__all__ names {name}, which does not exist"


@pytest.mark.parametrize("name", sorted(cs._BEFORE))
def test_modules_are_found_under_the_names_that_they_had(name: str) -> None:
    """The same module and not a copy, so that its classes are the same ones."""
    assert importlib.import_module(name) is importlib.import_module(cs._BEFORE[name])
