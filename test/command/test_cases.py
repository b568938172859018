"""Cases from YAML and JSON: which arguments they become, and what is refused."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from references import label, references

import cable_shape as cs
from cable_shape.command.case import Case, Reference
from cable_shape.command.case_output import distance_to_reference, rows, write
from cable_shape.command.load_case import load_case

ALONG_X = [0.5, 0.5, 0.5, 0.5]
CABLE = {"length": 1.2, "linear_density": 0.1, "bending_stiffness": 0.01}
PLAIN: dict[str, Any] = {
    "cable": CABLE,
    "start": {"position": [0, 0, 0], "quaternion": ALONG_X},
    "end": {"position": [0.8, 0, 0], "quaternion": ALONG_X},
}


def case_file(folder: Path, values: dict[str, Any], name: str = "case.yaml") -> Path:
    path = folder / name
    path.write_text(json.dumps(values) if name.endswith(".json") else yaml.safe_dump(values))
    return path


@pytest.mark.parametrize("name", ["case.yaml", "case.json"])
def test_a_case_is_the_arguments_of_predict(tmp_path: Path, name: str) -> None:
    values = {
        **PLAIN,
        "start": {**PLAIN["start"], "kind": "swivel", "curvature": [0, 0, 1]},
        "end": {**PLAIN["end"], "turns": 1, "offset": {"position": [0, 0, 0.1]}},
        "scene": {"masses": [{"arc_length": 0.6, "mass": 0.02}]},
        "model": "gradient4",
        "gravity": [0, 0, -1.62],
        "points": 40,
        "tolerance": 1e-4,
        "distributed_load": [[0, 0, 0], [0, 0.1, 0]],
    }
    case = load_case(case_file(tmp_path, values, name))
    assert case.name == "case"
    assert case.cable == cs.Cable(**CABLE)
    assert isinstance(case.end, cs.Grip)
    assert case.start.kind == "swivel"
    assert case.start.curvature.tolist() == [0.0, 0.0, 1.0]
    assert case.end.pose.turns == 1
    np.testing.assert_allclose(case.end.cable_frame.position, (0.9, 0.0, 0.0), atol=1e-15)
    assert case.scene is not None
    assert [(m.arc_length, m.mass) for m in case.scene.masses] == [(0.6, 0.02)]
    assert dict(case.options) == {
        key: values[key] for key in ("model", "gravity", "points", "tolerance", "distributed_load")
    }


def test_a_case_predicts_what_predict_does(tmp_path: Path) -> None:
    case = load_case(case_file(tmp_path, {**PLAIN, "model": "gradient4", "points": 30}))
    direct = cs.predict(
        cs.Cable(**CABLE),
        cs.Pose((0, 0, 0), ALONG_X),
        cs.Pose((0.8, 0, 0), ALONG_X),
        model="gradient4",
        points=30,
    )
    np.testing.assert_array_equal(case.predict().positions, direct.positions)
    assert case.predict(points=12).points == 12


def test_cable_and_scene_may_be_files_beside_the_case(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    case_file(tmp_path, CABLE, "parts/cable.yaml")
    case_file(tmp_path, {"masses": [{"arc_length": 0.5, "mass": 0.1}]}, "parts/scene.yaml")
    case = load_case(case_file(tmp_path, {**PLAIN, "cable": "parts/cable.yaml", "scene": "parts/scene.yaml"}))
    assert case.cable == cs.Cable(**CABLE)
    assert case.scene is not None
    assert len(case.scene.masses) == 1


@pytest.mark.parametrize(
    ("end", "mass", "force"),
    [(None, 0.0, [0.0, 0.0, 0.0]), ({"mass": 0.2, "force": [1, 0, 0]}, 0.2, [1.0, 0.0, 0.0])],
)
def test_an_end_may_be_free(tmp_path: Path, end: Any, mass: float, force: list[float]) -> None:
    case = load_case(case_file(tmp_path, {**PLAIN, "end": end}))
    assert isinstance(case.end, cs.FreeEnd)
    assert case.end.mass == mass
    assert case.end.force.tolist() == force


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"modle": "cosserat"}, "unknown key 'modle'. Did you mean 'model'?"),
        ({"cable": {**CABLE, "lenght": 1}}, "unknown key 'lenght'. Did you mean 'length'?"),
        ({"cable": {"length": 1.0}}, "linear_density"),
        ({"cable": {**CABLE, "bending_stiffness": -1}}, "bending_stiffness = -1"),
        ({"cable": "missing.yaml"}, "missing.yaml: no such file. Check the path"),
        ({"start": {"position": [0, 0]}}, "start: position"),
        ({"start": {"quaternion": ALONG_X}}, "start: position is missing"),
        ({"start": {"position": [0, 0, 0], "kind": "glued"}}, "start: kind = 'glued'"),
        ({"start": {"position": [0, 0, 0], "quaterion": ALONG_X}}, "Did you mean 'quaternion'?"),
        ({"start": [0, 0, 0]}, "start = [0, 0, 0] is not allowed: it must be a mapping"),
        ({"end": {"position": [0, 0, 0], "mass": 1}}, "end: it is either gripped"),
        ({"end": {"mass": -1}}, "end: mass = -1"),
        ({"end": {"position": [0, 0, math.nan]}}, "every entry must be finite"),
        ({"scene": {"obstacle": []}}, "Did you mean 'obstacles'?"),
    ],
)
def test_a_mistake_is_named_with_the_file(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    path = case_file(tmp_path, {**PLAIN, **changes})
    with pytest.raises(cs.ArgumentError) as caught:
        load_case(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert message in str(caught.value)


def test_start_and_cable_are_needed(tmp_path: Path) -> None:
    for key in ("cable", "start"):
        values = {name: value for name, value in PLAIN.items() if name != key}
        with pytest.raises(cs.ArgumentError, match=f"{key} is missing"):
            load_case(case_file(tmp_path, values))


REFERENCE: dict[str, Any] = {
    "name": "made_up",
    "kind": "shape",
    "cable": {
        "length": 1.0,
        "linear_density": 0.2,
        "EI1": 0.02,
        "EI2": 0.03,
        "GJ": 0.01,
        "EA": 50.0,
        "GA": None,
        "rest_curvature": [0.1, 0.2, 0.3],
    },
    "gravity": [0, 0, -9.81],
    "start": {"position": [0, 0, 0], "quaternion_xyzw": ALONG_X},
    "end": {"position": [0.8, 0, 0], "quaternion_xyzw": ALONG_X},
    "end_mass": 0.0,
    "end_force": [0, 0, 0],
    "end_moment": [0, 0, 0],
    "clips": [{"s": 0.4, "type": "ball", "position": [0.3, 0, 0], "quaternion_xyzw": None}],
    "point_masses": [{"s": 0.5, "mass": 0.1}],
    "twist": {"integral_u3": 0.0, "end_twist": 0.0},
    "solution": {"s": [0.0, 1.0], "r": [[0, 0, 0], [0.8, 0, 0]]},
}


def test_a_reference_case_maps_onto_the_arguments(tmp_path: Path) -> None:
    case = load_case(case_file(tmp_path, REFERENCE, "case.json"))
    assert case.cable == cs.Cable(
        length=1.0,
        linear_density=0.2,
        bending_stiffness=(0.02, 0.03),
        twisting_stiffness=0.01,
        axial_stiffness=50.0,
        rest_curvature=(0.1, 0.2, 0.3),
    )
    assert case.scene is not None
    (clip,), (mass,) = case.scene.clips, case.scene.masses
    assert (clip.arc_length, clip.kind, clip.pose.position.tolist()) == (0.4, "ball", [0.3, 0.0, 0.0])
    assert (mass.arc_length, mass.mass) == (0.5, 0.1)
    assert dict(case.options) == {"gravity": [0, 0, -9.81]}
    assert case.reference is not None


def about_d3(angle: float) -> list[float]:
    """The frame along x, turned about its own d3 by a continuous angle: q changes its sign after a whole turn."""
    from cable_shape.pose import multiply

    turn = np.array((0.0, 0.0, math.sin(angle / 2.0), math.cos(angle / 2.0)))
    return multiply(np.array(ALONG_X), turn).tolist()


@pytest.mark.parametrize(
    ("angle", "turns"),
    [(0.0, 0), (1.0, 0), (-3.0, 0), (3.5, 1), (2 * math.pi, 1), (-2 * math.pi, -1), (-4.7, -1), (7.85, 1), (13.0, 2)],
)
@pytest.mark.parametrize("known", ["end_twist", "integral_u3"])
def test_the_winding_of_a_reference_is_told_from_sign_and_twist(
    tmp_path: Path, angle: float, turns: int, known: str
) -> None:
    values = {
        **REFERENCE,
        "end": {"position": [0.8, 0, 0], "quaternion_xyzw": about_d3(angle)},
        "twist": {"integral_u3": angle, "end_twist": angle if known == "end_twist" else None},
    }
    case = load_case(case_file(tmp_path, values, "case.json"))
    assert isinstance(case.end, cs.Grip)
    assert case.end.pose.turns == turns


def test_a_critical_load_is_not_a_shape(tmp_path: Path) -> None:
    path = case_file(tmp_path, {"kind": "critical_value", "quantity": "P L^2/EI", "value": 2.5}, "case.json")
    with pytest.raises(cs.ArgumentError, match="it holds a critical load"):
        load_case(path)


def test_an_incomplete_reference_names_what_is_missing(tmp_path: Path) -> None:
    values = {key: value for key, value in REFERENCE.items() if key != "gravity"}
    with pytest.raises(cs.ArgumentError, match="not a complete reference case: KeyError 'gravity'"):
        load_case(case_file(tmp_path, values, "case.json"))


def test_all_reference_cases_are_understood() -> None:
    seen = 0
    for path in dict.fromkeys(references("*") + references("*", "published")):
        values = json.loads(path.read_text())
        if values.get("kind") == "critical_value":
            continue
        case = load_case(path)
        fields, solution = values["cable"], values["solution"]
        assert case.cable.bending_stiffness == (fields["EI1"], fields["EI2"])
        assert case.cable.axial_stiffness == fields["EA"]
        assert case.start.cable_frame.position.tolist() == [float(x) for x in values["start"]["position"]]
        assert isinstance(case.end, cs.FreeEnd) == (values["end"] is None)
        if isinstance(case.end, cs.FreeEnd):
            assert case.end.force.tolist() == values["end_force"]
        elif values["kind"] == "shape":
            # along the solution q is continuous: an odd winding is where its sign differs from w >= 0
            q = np.array(solution["q_xyzw"])
            w = float(np.array(q[0]) @ q[-1])
            assert case.end.pose.turns % 2 == (1 if w < 0.0 else 0), path.name
        assert case.reference is not None
        assert case.reference.positions.shape == (len(solution["s"]), 3)
        seen += 1
    assert seen >= 20


@pytest.mark.parametrize("path", references("catenary_*", "published"), ids=label)
def test_a_reference_catenary_comes_out(path: Path) -> None:
    case = load_case(path)
    shape = case.predict()
    assert shape.model == "catenary"
    distance = distance_to_reference(case, shape)
    assert distance is not None
    assert distance < 1e-5


def straight() -> tuple[Case, cs.CableShape]:
    """A shape of known numbers on the x axis, and a case with a reference 1 mm beside it."""
    n = 5
    shape = cs.CableShape(cs.CableShape.new_buffer(n), n, length=2.0, model="catenary", status=cs.Status.OK)
    shape.buffer[:] = 0.0
    shape.arc_length[:] = np.linspace(0.0, 2.0, n)
    shape.positions[:, 0] = shape.arc_length
    shape.quaternions[:] = ALONG_X
    shape.curvature[:, 0] = (0.0, 1.0, 4.0, 2.0, 1.0)
    shape.force[:] = (3.0, 0.0, 0.5)
    reference = Reference(
        np.array((0.0, 1.2, 2.0)), np.array(((0.0, 0.001, 0.0), (1.2, 0.001, 0.0), (2.0, 0.001, 0.0)))
    )
    case = Case("known", cs.Cable(2.0, 0.1, 0.01), cs.Grip(cs.Pose()), cs.FreeEnd(), None, {}, reference)
    return case, shape


def test_the_table_says_the_figures_in_words() -> None:
    table = dict(rows(*straight()))
    assert table["smallest bend radius"] == "0.25 m at s = 1 m"
    assert table["largest tension"] == "3 N at s = 0 m"
    assert table["force on the start grip"] == "(3, 0, 0.5) N"
    assert table["force on the end grip"] == "(-3, -0, -0.5) N"
    assert table["chord"] == "2 m, 100.00 % of the length"
    assert table["distance to the reference"].startswith("mean 0.0005 of the length")
    assert table["status"].startswith("OK: ")


def test_table_and_json_say_what_the_cable_does_to_its_clips(tmp_path: Path) -> None:
    scene = {"clips": [{"arc_length": 0.6, "position": [0.4, 0.1, -0.1], "kind": "ball"}]}
    case = load_case(case_file(tmp_path, {**PLAIN, "scene": scene}))
    shape = case.predict()
    (load,) = shape.clips
    assert np.linalg.norm(load.force) > 0.1
    assert any(name == "force on the clip at s = 0.6 m" and text.endswith(" N") for name, text in rows(case, shape))
    write(case, shape, tmp_path / "out.json")
    (entry,) = json.loads((tmp_path / "out.json").read_text())["clips"]
    assert entry == {"arc_length": 0.6, "force": load.force.tolist(), "moment": load.moment.tolist()}


def test_json_and_csv_hold_the_arrays(tmp_path: Path) -> None:
    case, shape = straight()
    write(case, shape, tmp_path / "deep" / "out.json")
    values = json.loads((tmp_path / "deep" / "out.json").read_text())
    assert values["status"] == "OK"
    assert values["positions"] == shape.positions.tolist()
    assert values["cable"]["length"] == 2.0
    write(case, shape, tmp_path / "out.csv")
    with (tmp_path / "out.csv").open() as file:
        header, *lines = list(csv.reader(file))
    assert header[:5] == ["arc_length [m]", "x [m]", "y [m]", "z [m]", "qx"]
    table = np.array(lines, float)
    assert table.shape == (5, 17)
    np.testing.assert_allclose(table[:, 1:4], shape.positions)
    np.testing.assert_allclose(table[:, 11:14], shape.force)


def test_the_picture_is_drawn(tmp_path: Path) -> None:
    write(*straight(), tmp_path / "out.png")
    assert (tmp_path / "out.png").read_bytes().startswith(b"\x89PNG")


def test_another_ending_is_refused(tmp_path: Path) -> None:
    with pytest.raises(cs.ArgumentError, match=r"its ending must be one of \.json, \.csv, \.png"):
        write(*straight(), tmp_path / "out.xlsx")
