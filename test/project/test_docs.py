"""The site: every page has its place, nothing comes from elsewhere, and it is built without a warning."""

import importlib.util
import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement

import cable_shape as cs

ROOT = Path(__file__).resolve().parents[2]
SITE = yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))
REFERENCE = (ROOT / "docs" / "reference.md").read_text(encoding="utf-8")


def leaves(tree):
    if isinstance(tree, str):
        return [tree]
    return [leaf for entry in (tree.values() if isinstance(tree, dict) else tree) for leaf in leaves(entry)]


def test_every_page_has_one_place():
    pages = {file.name for file in (ROOT / "docs").glob("*.md")} | {"index.md", "changelog.md", "contributing.md"}
    assert sorted(leaves(SITE["nav"])) == sorted(pages)


def test_every_picture_is_shown():
    texts = [file.read_text(encoding="utf-8") for file in (ROOT / "README.md", *(ROOT / "docs").glob("*.md"))]
    for picture in (ROOT / "docs" / "images").iterdir():
        assert any(f"images/{picture.name})" in text for text in texts), picture.name


def test_the_reference_has_every_export():
    named = re.findall(r"^::: (.*)$", REFERENCE, flags=re.MULTILINE)
    modules = {f"cable_shape.{module}" for module in cs._MODULES.values()}
    for module in modules:
        assert any(name == module or name.startswith(f"{module}.") for name in named), module
    for name in named:
        assert _is_module(name) or _is_module(name.rpartition(".")[0]), name


def _is_module(name):
    try:
        return importlib.util.find_spec(name) is not None
    except ModuleNotFoundError:
        return False


def test_nothing_comes_from_elsewhere():
    assert SITE["theme"]["font"] is False
    assert not {"extra_javascript", "extra"} & set(SITE)
    assert all((ROOT / "docs" / file).is_file() for file in SITE["extra_css"])


def test_the_pins_of_its_tools_are_those_of_the_extra():
    lines = (ROOT / "docs" / "requirements.txt").read_text().splitlines()
    pins = {pin.name: pin for pin in map(Requirement, (line for line in lines if not line.startswith("#")))}
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    wanted = {asked.name: asked for asked in map(Requirement, project["optional-dependencies"]["docs"])}
    assert set(pins) == set(wanted)
    for name, pin in pins.items():
        (exact,) = pin.specifier
        assert exact.operator == "=="
        assert wanted[name].specifier.contains(exact.version)


def test_the_command_of_the_tests_brings_its_tools():
    assert '"$root/scripts/docs" --tools' in (ROOT / "scripts" / "test").read_text(encoding="utf-8")


def builder():
    """mkdocs of this environment or of scripts/docs; None where neither has been installed."""
    for folder in (Path(sys.executable).parent, ROOT / ".venv-docs" / "bin"):
        if (folder / "mkdocs").is_file():
            return folder / "mkdocs"
    found = shutil.which("mkdocs")
    return found and Path(found)


def test_the_site_is_built_without_a_warning(tmp_path):
    mkdocs = builder()
    if mkdocs is None:
        assert "CI" not in os.environ, "scripts/test installs what builds the site: scripts/docs --tools"
        pytest.skip("mkdocs is not installed: run scripts/docs --tools once")
    command = [mkdocs, "build", "--strict", "--quiet", "--site-dir", tmp_path / "site"]
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(
        command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=300, check=False
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert not done.stderr
    index = (tmp_path / "site" / "index.html").read_text(encoding="utf-8")
    assert "docs/node.md" not in re.findall(r'href="([^"]*)"', index)
    assert not re.findall(r'(?:src|href)="https?://(?:fonts|cdn|unpkg)[^"]*"', index)
    reference = (tmp_path / "site" / "reference.html").read_text(encoding="utf-8")
    assert "predict_batch" in reference
    assert not re.findall(r":[a-z]+:<code>", reference), "roles of docstrings are links"
    everything = [file.read_text(encoding="utf-8") for file in (tmp_path / "site").glob("*.html")]
    assert not [hit for text in everything for hit in re.findall(r'<(?:script|link|img)[^>]*="https?://[^"]*"', text)]
    assert (tmp_path / "site" / "search" / "search_index.json").is_file()
