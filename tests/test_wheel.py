"""The wheel as a user gets it: small, with everything it needs at run time, and at work away from the sources."""

import os
import subprocess
import sys
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
def wheel(tmp_path_factory) -> Path:
    """Built from a copy of what git tracks, so that nothing that lies about gets in."""
    folder = tmp_path_factory.mktemp("wheel")
    for name in tracked():
        if name.parts[0] == "neural_strands" or len(name.parts) == 1:
            target = folder / "sources" / name
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes((ROOT / name).read_bytes())
    build = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation"]
    done = subprocess.run(
        [*build, "--wheel-dir", str(folder), str(folder / "sources")], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    (built,) = folder.glob("*.whl")
    return built


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
