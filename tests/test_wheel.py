"""Wheel and sdist as a user gets them: small, with what is needed at run time, and at work away from the sources."""

import os
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
MOST_BYTES = 5_000_000


def tracked() -> list[Path]:
    """The files that git tracks."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=False)
    if listed.returncode:
        pytest.skip("the sources are not a git checkout")
    return [Path(name) for name in listed.stdout.decode().split("\0") if name]


@pytest.fixture(scope="module")
def sources(tmp_path_factory) -> Path:
    """A copy of what git tracks, so that nothing that lies about gets in."""
    folder = tmp_path_factory.mktemp("sources")
    for name in tracked():
        if name.parts[0] in ("neural_strands", "tests") or len(name.parts) == 1:
            target = folder / name
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes((ROOT / name).read_bytes())
    return folder


@pytest.fixture(scope="module")
def wheel(sources) -> Path:
    """Built as a release is."""
    return built(sources)


def built(sources: Path) -> Path:
    """The wheel of a folder of sources, or of an sdist."""
    folder = sources.parent / f"{sources.name}.wheel"
    build = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation"]
    done = subprocess.run(
        [*build, "--wheel-dir", str(folder), str(sources)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    (found,) = folder.glob("*.whl")
    return found


def contents(wheel: Path) -> dict[str, bytes]:
    """The files of a wheel, apart from the list of their hashes."""
    with zipfile.ZipFile(wheel) as archive:
        return {name: archive.read(name) for name in archive.namelist() if not name.endswith("/RECORD")}


def test_the_wheel_is_small_and_holds_only_the_package(wheel):
    assert wheel.stat().st_size < MOST_BYTES
    with zipfile.ZipFile(wheel) as archive:
        names = [Path(name) for name in archive.namelist()]
    package = [name for name in names if name.parts[0] == "neural_strands"]
    assert {name.parts[0] for name in names} - {"neural_strands"} == {f"{wheel.name.rsplit('-', 3)[0]}.dist-info"}
    assert set(package) == {name for name in tracked() if name.parts[0] == "neural_strands"}


def test_the_wheel_works_away_from_the_sources(wheel, tmp_path):
    """Reads the shipped prior and draws a groom, from where the wheel was unpacked."""
    site = tmp_path / "site"
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(site)
    environment = {**os.environ, "PYTHONPATH": str(site)}
    script = (
        "import neural_strands as ns; from neural_strands.prior.vae import load_prior; load_prior(); print(ns.__file__)"
    )
    for words in (["-c", script], ["-m", "neural_strands", "--version"], ["-m", "neural_strands", "fit", "--help"]):
        done = subprocess.run(
            [sys.executable, *words], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        if words[0] == "-c":
            assert Path(done.stdout.strip()).is_relative_to(site)


def test_the_sdist_holds_the_package_and_builds_the_same_wheel(sources, wheel):
    program = "import sys; from setuptools import build_meta; build_meta.build_sdist(sys.argv[1])"
    done = subprocess.run(
        [sys.executable, "-c", program, "dist"], cwd=sources, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    (sdist,) = (sources / "dist").glob("*.tar.gz")
    with tarfile.open(sdist) as archive:
        names = [Path(*Path(each.name).parts[1:]) for each in archive.getmembers() if each.isfile()]
    package = {name for name in names if name.parts[0] == "neural_strands"}
    assert package == {name for name in tracked() if name.parts[0] == "neural_strands"}
    assert {name.name for name in names if len(name.parts) == 1} >= {"LICENSE", "README.md", "pyproject.toml"}
    assert {name.parts[0] for name in names if len(name.parts) > 1} == {"neural_strands", "neural_strands.egg-info"}
    assert contents(built(sdist)) == contents(wheel)
