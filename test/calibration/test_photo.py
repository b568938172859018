"""Calibration from clicks in a photograph: a synthetic camera sees a cable in a plane."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

import cable_shape as cs
from cable_shape.calibration.photo import Clicks, homography, load_clicks, mapped, plane_of, similarity, to_pixels
from cable_shape.command.cli import main
from cable_shape.errors import ArgumentError, UnknownKeyError

TRUE = cs.Cable(length=1.0, linear_density=0.06, bending_stiffness=0.004)
#: metres in the plane (x to the right, y up) to pixels: straight on, and askew
STRAIGHT = np.array(((900.0, 0.0, 300.0), (0.0, -900.0, 250.0), (0.0, 0.0, 1.0)))
ASKEW = np.array(((900.0, 60.0, 300.0), (90.0, -880.0, 250.0), (0.25, 0.1, 1.0)))
CORNERS = np.array(((-0.2, 0.2), (1.0, 0.2), (1.0, -0.7), (-0.2, -0.7), (0.4, 0.25)))


def level(x: float, z: float, pitch: float = 0.0) -> cs.Pose:
    """d3 = x, turned down by `pitch`."""
    half = 0.25 * math.pi + 0.5 * pitch
    return cs.Pose((x, 0.0, z), (0.0, math.sin(half), 0.0, math.cos(half)))


def clicks(
    camera: np.ndarray,
    rng: np.random.Generator,
    noise: float = 0.0,
    *,
    known=CORNERS,
    plumb=False,
    along=True,
    tilt=0.0,
) -> Clicks:
    """Of TRUE between two clamps (or pins), tilted in the picture by `tilt` [rad]."""
    ends = level(0.0, 0.0), level(0.75, 0.05, 0.2)
    kind = "clamped" if along else "pinned"
    shape = cs.predict(TRUE, *(cs.Grip(p, kind=kind) for p in ends), model="cosserat", points=201)
    c, s = math.cos(tilt), math.sin(tilt)
    turned = np.array(((c, s), (-s, c)))

    def seen(places):
        return to_pixels(np.linalg.inv(camera), np.atleast_2d(places) @ turned) if len(places) else np.empty((0, 2))

    direction = (0.06 * math.cos(0.2), -0.06 * math.sin(0.2))
    places = {
        "start": [(0.0, 0.0)],
        "start_along": [(0.06, 0.0)] if along else [],
        "end": [(0.75, 0.05)],
        "end_along": [(0.75 + direction[0], 0.05 + direction[1])] if along else [],
        "point": shape.positions[10:-10:9][:, [0, 2]],
        "known": known,
        "plumb": [(0.4, 0.2), (0.4, -0.6)] if plumb else [],
    }
    pixels = {kind: seen(np.array(at)) for kind, at in places.items()}
    pixels = {kind: a + noise * rng.normal(size=a.shape) for kind, a in pixels.items()}
    return Clicks(pixels, np.array(known, dtype=float).reshape(-1, 2), np.full(len(places["point"]), math.nan))


def stiffness(found: cs.Calibration) -> float:
    return found.cable.mean_bending_stiffness


ROUGH = TRUE.replace(bending_stiffness=0.012, twisting_stiffness=None)


def test_maps_come_back_exactly() -> None:
    pixels = to_pixels(np.linalg.inv(ASKEW), CORNERS)
    plane = homography(pixels, CORNERS)
    np.testing.assert_allclose(mapped(plane, pixels), CORNERS, atol=1e-12)
    some = np.array(((0.3, -0.2), (0.9, 0.1)))
    np.testing.assert_allclose(mapped(plane, to_pixels(np.linalg.inv(ASKEW), some)), some, atol=1e-12)
    pixels = to_pixels(np.linalg.inv(STRAIGHT), CORNERS[:2])
    np.testing.assert_allclose(similarity(pixels, CORNERS[:2]) * 900.0, 900.0 * np.linalg.inv(STRAIGHT), atol=1e-9)


@pytest.mark.parametrize(
    ("camera", "options", "chord"),
    [
        (ASKEW, {}, None),
        (ASKEW, {"plumb": True, "tilt": 0.2}, None),
        (STRAIGHT, {"known": CORNERS[:2]}, None),
        (STRAIGHT, {"known": CORNERS[[0, 2]], "plumb": True}, None),
        (STRAIGHT, {"known": np.empty((0, 2)), "plumb": True, "tilt": -0.3}, math.hypot(0.75, 0.05)),
        (ASKEW, {"along": False}, None),
    ],
)
def test_exact_clicks_give_the_exact_cable(camera, options, chord) -> None:
    seen = clicks(camera, np.random.default_rng(0), **options)
    found = cs.calibrate_photo(seen, ROUGH, chord=chord).found
    assert found.converged
    assert stiffness(found) == pytest.approx(0.004, rel=2e-3)
    assert found.distances.max() < 1e-4


def test_a_free_end_needs_no_end() -> None:
    shape = cs.predict(TRUE, level(0.0, 0.0), None, model="cosserat", points=201)
    seen = clicks(STRAIGHT, np.random.default_rng(0))
    pixels = {**seen.pixels, "end": np.empty((0, 2)), "end_along": np.empty((0, 2))}
    pixels["point"] = to_pixels(np.linalg.inv(STRAIGHT), shape.positions[10::9][:, [0, 2]])
    seen = Clicks(pixels, seen.places, np.full(len(pixels["point"]), math.nan))
    assert stiffness(cs.calibrate_photo(seen, ROUGH).found) == pytest.approx(0.004, rel=2e-3)


def test_the_error_bars_hold_the_clicks_on_grips_and_known_points() -> None:
    """Many photographs of one cable: the scatter of ln EI is its error, which is not that of the points alone."""
    rng = np.random.default_rng(7)
    logs, errors, points_only = [], [], []
    for _ in range(40):
        seen = clicks(ASKEW, rng, noise=2.0)
        found = cs.calibrate_photo(seen, ROUGH, click_error=2.0).found
        logs.append(math.log(stiffness(found)))
        errors.append(found["bending_stiffness"].relative)
        points_only.append(cs.calibrate_photo(seen, ROUGH, click_error=0.0).found["bending_stiffness"].relative)
    scatter = float(np.std(logs))
    assert 0.7 < scatter / float(np.median(errors)) < 1.4
    assert float(np.median(points_only)) < 0.6 * scatter
    assert any("come from the clicks on grips and known points" in remark for remark in found.remarks)


def test_points_in_a_plane_have_scatter_in_one_direction() -> None:
    seen = clicks(STRAIGHT, np.random.default_rng(3))
    pixels = dict(seen.pixels)
    rng = np.random.default_rng(4)
    shape = cs.predict(TRUE, level(0.0, 0.0), level(0.75, 0.05, 0.2), model="cosserat", points=401)
    pixels["point"] = to_pixels(np.linalg.inv(STRAIGHT), shape.positions[5:-5, [0, 2]])
    pixels["point"] = pixels["point"] + 2.0 * rng.normal(size=pixels["point"].shape)
    many = Clicks(pixels, seen.places, np.full(len(pixels["point"]), math.nan))
    found = cs.calibrate_photo(many, ROUGH, click_error=0.0).found
    assert found.scale == pytest.approx(2.0 / 900.0, rel=0.1)


def write(file: Path, seen: Clicks) -> Path:
    lines = ["what,u,v,x,y"]
    for kind, pixels in seen.pixels.items():
        for row, (u, v) in enumerate(pixels.tolist()):
            place = f"{seen.places[row, 0]},{seen.places[row, 1]}" if kind == "known" else ","
            lines.append(f"{kind},{u!r},{v!r},{place}")
    file.write_text("\n".join(lines) + "\n")
    return file


def test_the_command_from_clicks_with_the_photograph_in_its_picture(tmp_path: Path, capsys) -> None:
    from matplotlib.image import imsave

    seen = clicks(ASKEW, np.random.default_rng(1), noise=1.0)
    file = write(tmp_path / "clicks.csv", seen)
    read = load_clicks(file)
    np.testing.assert_array_equal(read.pixels["point"], seen.pixels["point"])
    np.testing.assert_array_equal(read.places, seen.places)
    imsave(tmp_path / "photo.png", np.full((900, 1300, 3), 200, dtype=np.uint8))
    out, known = tmp_path / "cable.yaml", tmp_path / "known.yaml"
    command = ["calibrate", str(file), "--length", "1.0", "--mass", "0.06", "-o", str(out), "--uncertainty", str(known)]
    picture = ["--report", str(tmp_path / "r.png"), "--picture", str(tmp_path / "photo.png")]
    assert main([*command, *picture]) == 0
    assert "standard error" in capsys.readouterr().out
    assert (tmp_path / "r.png").read_bytes()[:4] == b"\x89PNG"
    assert cs.Cable.from_yaml(out).mean_bending_stiffness == pytest.approx(0.004, rel=0.3)
    assert cs.Uncertainty.from_yaml(known).names == ("bending_stiffness",)
    assert main([*command, "--report", str(tmp_path / "r.json")]) == 0
    assert json.loads((tmp_path / "r.json").read_text())["estimates"]
    assert main([*command, "--report", str(tmp_path / "r2.png"), "--picture", str(file)]) == 2
    assert "cannot be read as an image" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("what,u,v,w\n", "unknown key 'w'"),
        ("what,u,v\nstart,1\n", "line 2"),
        ("what,u,v\nstrat,1,2\n", "what = 'strat'"),
        ("what,u,v\nstart,1,2\nstart,3,4\n", "start = '2 clicks'"),
        ("what,u,v\nstart,1,2\n", "point = '0 clicks'"),
        ("what,u,v,x,y\nknown,1,2,3\n", "line 2"),
    ],
)
def test_bad_tables_are_named(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "clicks.csv").write_text(text)
    with pytest.raises(ArgumentError, match=words):
        load_clicks(tmp_path / "clicks.csv")
    assert issubclass(UnknownKeyError, ArgumentError)


def test_clicks_without_a_scale_or_a_plane_are_refused() -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(ArgumentError, match="pixels have no scale"):
        plane_of(clicks(STRAIGHT, rng, known=CORNERS[:1], plumb=True))
    line = np.column_stack((np.linspace(0, 1, 5), np.zeros(5)))
    with pytest.raises(ArgumentError, match="do not fix the plane"):
        plane_of(clicks(STRAIGHT, rng, known=line))
    with pytest.raises(ArgumentError, match="apart"):
        plane_of(clicks(STRAIGHT, rng, known=CORNERS[[0, 0]]))
    seen = clicks(STRAIGHT, rng, plumb=True)
    seen.pixels["plumb"] = seen.pixels["plumb"][:1]
    with pytest.raises(ArgumentError, match="two"):
        plane_of(seen)
