"""YAML and JSON: what is ambiguous, too large or another kind of file is refused, by line and key, unquoted."""

from __future__ import annotations

import json
import math
from pathlib import Path
from time import process_time
from typing import Any

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

import cable_shape as cs
from cable_shape.cable.cable import Cable
from cable_shape.cable.case_parts import FREE_END_KEYS, GRIP_KEYS, POSE_KEYS
from cable_shape.command.load_case import CASE_KEYS
from cable_shape.files.yaml_files import MAX_DEPTH, MAX_VALUES, WORDS, load_yaml
from cable_shape.scene.scene import SCENE_KEYS
from cable_shape.scene.scene_files import SOLID_KEYS

CONFIG = Path(__file__).resolve().parents[2] / "config"
MERGES = "a: &a {length: 1}\n" + "".join(
    f"b{i}: &b{i} {{<<: [{','.join(['*' + ('a' if i == 0 else f'b{i - 1}')] * 9)}]}}\n" for i in range(9)
)
ALIASES = "a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1]\n" + "".join(
    f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]\n" for k in range(1, 12)
)
CHAIN = "length: &c0 []\n" + "".join(f"a{k}: &c{k} [*c{k - 1}]\n" for k in range(1, 500))


def loaded(text: str, folder: Path, name: str = "cable.yaml") -> dict[str, Any]:
    (folder / name).write_text(text)
    return load_yaml(folder / name)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("length: 1.2\nlength: 1200\n", r"line 2, key 'length': it was given before, in line 1\. Keep one"),
        ("tails: {start: 1,\n  start: 2}\n", r"line 2, key 'start': it was given before, in line 1"),
        ("length: 1:30\n", r"line 1, key 'length': YAML takes colons between digits for base 60"),
        ("mass: 1:30.5\n", r"line 1, key 'mass': YAML takes colons between digits for base 60"),
        ("length: 1\ndiameter: 010\n", r"line 2, key 'diameter': YAML takes .* for octal\. Remove the 0"),
        ("length: 1" + "0" * 5000, r"line 1, key 'length': a whole number of more than 19 digits"),
        ("length: 0x" + "f" * 5000, r"line 1, key 'length': a whole number of more than 19 digits"),
        ("length: " + "[" * 65 + "]" * 65, r"line 1, key 'length': nested more than 64 deep\. Write it flatter"),
        ("length: " + "[" * 100_000, r"line 1, key 'length': nested more than 64 deep"),
        (CHAIN, r"line \d+: aliases nest more than 64 deep"),
        (MERGES, rf"aliases \(\*name\) make more than {MAX_VALUES} values"),
        (ALIASES, rf"aliases \(\*name\) make more than {MAX_VALUES} values"),
        ("length: &a [*a]\n", r"line 1, key 'length': an alias to nothing before it"),
        ("length: &a {<<: *a}\n", r"line 1: an alias to nothing before it"),
        ("length: {<<: [1]}\n", r"line 1: << merges mappings only"),
        ("length: !!python/object/apply:os.system ['true']\n", r"line 1, key 'length': tags \(!\) are not read"),
        ("length: !!python/name:os.system x\n", r"line 1, key 'length': this tag \(!\) is not read"),
        ("length: !!int 1.5\n", r"line 1, key 'length': this tag \(!\) is not read"),
        ("length: 1\n---\nlength: 2\n", r"line 2: a second document begins"),
        ("? [length]\n: 1\n", r"line 1: a key must be a word"),
        ("length: 1\n\tdiameter: 2\n", r"line 2.*: not well formed: found a tab character"),
        ("length: \x07", "it has characters that YAML does not allow"),
        ("", "the top level must be a mapping of keys to values, but it is empty"),
        ("[length]", "the top level must be a mapping of keys to values, but it is a list"),
        ("length", "the top level must be a mapping of keys to values, but it is one value"),
    ],
)
def test_ambiguous_and_malformed_yaml_is_refused_by_line_and_key(text: str, told: str, tmp_path: Path) -> None:
    began = process_time()
    with pytest.raises(cs.InputError, match=rf"cable\.yaml.*{told}"):
        loaded(text, tmp_path)
    assert process_time() - began < 10.0


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ('{"length": 1, "length": 2}', r"key 'length': a key is given twice in one mapping"),
        ('{"length": 1' + "0" * 5000 + "}", "a whole number of more than 19 digits"),
        ('{"length": ' + "[" * 65 + "]" * 65 + "}", "nested more than 64 deep"),
        ('{"length": ' + "[" * 100_000, "nested more than 64 deep"),
        ('{"length":\nsecret}', "line 2: not well formed: Expecting value"),
        ("[1]", "but it is a list"),
    ],
)
def test_json_is_read_as_strictly(text: str, told: str, tmp_path: Path) -> None:
    with pytest.raises(cs.FileError, match=told) as caught:
        loaded(text, tmp_path, "case.json")
    assert "secret" not in str(caught.value)


@pytest.mark.parametrize(
    "text",
    [
        "root:$6$secret$x:19000:0:99999:7:::\nbin:*:19000:0:99999:7:::\n",
        "secret: 1\nsecret: 2\n",
        "secret: &secret [*secret]\n",
        "secret: 'secret\n",
        "secret: %secret\n\tsecret",
        "password: secret\n",
        "!secret!secret a\n",
        "- secret\n",
        "*secret : secret\n",
        "secret: {secret: 1:30}\n",
    ],
)
def test_nothing_is_quoted_from_a_file_that_is_another_one(text: str, tmp_path: Path) -> None:
    file = tmp_path / "cable.yaml"
    file.write_text(text)
    for read in (cs.Cable.from_yaml, cs.Scene.from_yaml):
        with pytest.raises(cs.FileError, match=r"cable\.yaml") as caught:
            read(file)
        assert "secret" not in str(caught.value)
        assert "bin" not in str(caught.value)
        assert caught.value.__cause__ is None


def test_keys_that_are_no_words_are_not_quoted_beside_known_ones(tmp_path: Path) -> None:
    file = tmp_path / "cable.yaml"
    file.write_text("length: 1\nroot:$6$secret$x:19000:0:99999:7:::\n")
    with pytest.raises(cs.UnknownKeyError, match=r"cable.yaml: a key that is not a word\. Known keys") as caught:
        cs.Cable.from_yaml(file)
    assert "secret" not in str(caught.value)


def test_what_is_meant_is_read(tmp_path: Path) -> None:
    text = (
        "length: &one 1.0\nbending_stiffness: [*one, *one]\nlinear_density: 1e-3\ndiameter: .5\nmass: -1.5E+3\n"
        "kind: '1:30'\nname: 2026-01-02\nradius: .inf\nangle: .nan\nclips: null\nhome: ~\ncontact: \"off\"\n"
        "box: [0x1f, 0b11, 0, 00, 0.5, 1_000, +3]\nplug: off\nlink: !!str 5\nforce: !!float 1\n"
        "start: &base {position: 1, angle: 2}\nend: {<<: *base, angle: 3}\nleft: {<<: [{kind: a}, *base, {kind: b}]}\n"
    )
    read = loaded(text, tmp_path)
    assert math.isnan(read.pop("angle"))
    assert read == {
        "length": 1.0, "bending_stiffness": [1.0, 1.0], "linear_density": 1e-3, "diameter": 0.5, "mass": -1500.0,
        "kind": "1:30", "name": "2026-01-02", "radius": math.inf, "clips": None, "home": None, "contact": "off",
        "box": [31, 3, 0, 0, 0.5, 1000, 3], "plug": False, "link": "5", "force": 1.0,
        "start": {"position": 1, "angle": 2}, "end": {"position": 1, "angle": 3},
        "left": {"kind": "a", "position": 1, "angle": 2},
    }  # fmt: skip
    assert isinstance(read["force"], float)
    assert loaded("length: " + "[" * (MAX_DEPTH - 1) + "]" * (MAX_DEPTH - 1), tmp_path)


text = st.text("abyz :#-'\"\n{}[]*&!%@?|>~é", max_size=12)
values = st.recursive(
    st.none() | st.booleans() | st.integers(-(10**17), 10**17) | st.floats(allow_nan=False) | text,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(text, inner, max_size=4),
    max_leaves=20,
)


@settings(max_examples=200, deadline=None)
@given(st.dictionaries(st.sampled_from(sorted(WORDS)), values, min_size=1, max_size=5), st.booleans())
def test_what_is_written_is_read_again(tmp_path_factory: pytest.TempPathFactory, data: dict[str, Any], c: bool) -> None:
    folder = tmp_path_factory.getbasetemp()
    assert loaded(json.dumps(data), folder, "any.json") == data
    (folder / "any.yaml").write_text(yaml.safe_dump(data, allow_unicode=c))
    assert load_yaml(folder / "any.yaml") == data


def test_files_of_the_package_are_read_as_by_the_library() -> None:
    files = [*CONFIG.glob("cables/*.yaml"), *CONFIG.glob("scenes/*.yaml"), *CONFIG.glob("uncertainty/*.yaml")]
    assert len(files) > 5
    for file in [*files, *CONFIG.glob("robots/*.yaml")]:
        assert load_yaml(file) == yaml.safe_load(file.read_text())


def test_the_slow_parser_says_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    texts = ["length: 1:30\n", "length: 'x\n", MERGES, "length: [1, 2, {start: 1e-3}]\n"]

    def told(text: str) -> Any:
        try:
            return loaded(text, tmp_path)
        except cs.FileError as error:
            return str(error).split(": ")[0]

    fast = [told(text) for text in texts]
    monkeypatch.delattr(yaml, "CSafeLoader")
    assert [told(text) for text in texts] == fast


def test_all_keys_of_all_files_are_known_words() -> None:
    assert {*Cable.__slots__, *SCENE_KEYS, *SOLID_KEYS} <= WORDS
    assert {*CASE_KEYS, *POSE_KEYS, *GRIP_KEYS, *FREE_END_KEYS} <= WORDS
