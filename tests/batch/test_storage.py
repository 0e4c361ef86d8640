"""Local and remote places: a real S3 server in a separate process."""

import os
import socket
import subprocess
import sys
import time
from urllib.error import URLError
from urllib.request import Request, urlopen

import pytest
import torch
from batch_files import write_ball, write_subjects

from neural_strands.batch import storage
from neural_strands.batch.storage import Store, fetched, is_remote, workspace
from neural_strands.batch.subjects import Demand, read_subjects
from neural_strands.batch.task import Task, perform
from neural_strands.fitting import fit as fit_module
from neural_strands.foundation.errors import InputError

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning:botocore.*", "ignore::ResourceWarning")


@pytest.fixture(scope="module")
def server():
    """Address of the server."""
    for name in ("s3fs", "moto", "flask", "flask_cors"):
        pytest.importorskip(name, reason=f"{name} is not installed")
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    process = subprocess.Popen(
        [sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", str(port)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    address, end = f"http://127.0.0.1:{port}", time.monotonic() + 60
    try:
        while True:
            try:
                urlopen(address, timeout=5).close()
                break
            except URLError:
                assert process.poll() is None
                assert time.monotonic() < end
                time.sleep(0.2)
        yield address
    finally:
        process.terminate()
        process.wait(30)


@pytest.fixture
def bucket(server, monkeypatch):
    """URL of an empty bucket."""
    settings = {"AWS_ENDPOINT_URL": server, "AWS_ACCESS_KEY_ID": "a", "AWS_SECRET_ACCESS_KEY": "b"}
    for name, value in {**settings, "AWS_DEFAULT_REGION": "us-east-1"}.items():
        monkeypatch.setenv(name, value)
    urlopen(Request(f"{server}/moto-api/reset", method="POST")).close()
    urlopen(Request(f"{server}/heads", method="PUT")).close()
    import s3fs

    s3fs.S3FileSystem.clear_instance_cache()
    return "s3://heads"


def test_places_are_told_apart():
    assert is_remote("s3://heads/bob")
    assert not is_remote("heads/bob")
    assert not is_remote("C:\\heads")


def test_a_local_folder_is_worked_on_in_place(tmp_path):
    store = Store(str(tmp_path / "bob"))
    with workspace(store, ("run",), None) as folder:
        assert folder == tmp_path / "bob"
        store.write("run/a", b"1")
    assert store.read("run/a", "a file") == b"1"
    assert store.read("run/b", "a file") is None
    assert fetched(str(tmp_path / "bob"), tmp_path / "copy") == tmp_path / "bob"


def test_a_store_without_its_package_is_one_sentence(tmp_path):
    with pytest.raises(InputError, match=r"nowhere://a/b: expected a location that can be read"):
        Store("nowhere://a/b").read("c", "a file")


def test_a_remote_folder_is_kept_like_its_copy(bucket, monkeypatch):
    store = Store(bucket).child("bob")
    store.write("run/kept", b"1")
    store.write("run/gone", b"2")
    store.write("capture/preparation/large", b"3")
    store.write("other", b"4")
    monkeypatch.setattr(storage, "UPLOAD_SECONDS", 0.2)
    with workspace(store, ("run", "capture"), "capture/preparation/") as folder:
        assert sorted(path.name for path in folder.rglob("*") if path.is_file()) == ["gone", "kept"]
        (folder / "run" / "gone").unlink()
        (folder / "run" / ".new.01234567").write_bytes(b"unfinished")
        (folder / "inputs").mkdir()
        (folder / "inputs" / "photo").write_bytes(b"large")
        (folder / "run" / "new").write_bytes(b"5")
        end = time.monotonic() + 30
        while store.read("run/new", "a file") is None and time.monotonic() < end:
            time.sleep(0.1)
        assert store.read("run/new", "a file") == b"5"
        (folder / "run" / "new").write_bytes(b"66")
    assert not folder.exists()
    assert store.read("run/new", "a file") == b"66"
    assert store.read("run/kept", "a file") == b"1"
    for name in ("run/gone", "run/.new.01234567", "inputs/photo"):
        assert store.read(name, "a file") is None
    assert store.read("capture/preparation/large", "a file") == b"3"


def test_remote_inputs_are_fetched_once(bucket, tmp_path):
    Store(bucket).write("ball/images/a.png", b"1")
    assert (fetched(f"{bucket}/ball", tmp_path / "ball") / "images" / "a.png").read_bytes() == b"1"
    assert fetched(f"{bucket}/ball/images/a.png", tmp_path / "a.png").read_bytes() == b"1"
    Store(bucket).write("ball/images/a.png", b"2")
    assert (fetched(f"{bucket}/ball", tmp_path / "ball") / "images" / "a.png").read_bytes() == b"1"
    with pytest.raises(InputError, match="s3://heads/none: expected files, found nothing there"):
        fetched(f"{bucket}/none", tmp_path / "none")


def test_a_bucket_that_is_not_there_is_one_sentence(bucket):
    with pytest.raises(InputError, match=r"s3://other/bob: expected a location that can be read and written"):
        Store("s3://other").child("bob").write("a", b"1")


@pytest.mark.usefixtures("shapes_unchecked")
def test_a_fit_in_an_object_store_goes_on_elsewhere_with_the_same_bits(bucket, tmp_path, monkeypatch):
    monkeypatch.setenv("NEURAL_STRANDS_WEIGHTS", str(tmp_path / "none"))
    ball = write_ball(tmp_path)
    store = Store(f"{bucket}/captures")
    names = [path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*") if path.is_file()]
    store.upload(tmp_path, names)
    far = {"capture": f"{store.place}/ball", "segments": f"{store.place}/segments.npz"}
    subjects = read_subjects(
        write_subjects(tmp_path / "s.toml", {"near": ball, "far": far}, steps=6, initialise="mean")
    ).subjects
    near, far = (
        Task(subject, "fit", out, Demand(cores=torch.get_num_threads(), gpu=0.0))
        for subject, out in zip(subjects, (str(tmp_path / "out"), f"{bucket}/out"), strict=True)
    )
    assert perform(near, lambda _: None).failure == ""
    steps, take = [], fit_module._take_step

    def stopped(*arguments):
        steps.append(1)
        if len(steps) == 2:
            raise KeyboardInterrupt
        take(*arguments)

    with monkeypatch.context() as patch:
        patch.setattr(fit_module, "_take_step", stopped)
        with pytest.raises(KeyboardInterrupt):
            perform(far, lambda _: None)
    kept = Store(far.out).child("far")
    assert kept.read("run/checkpoint.pt", "a file") is not None
    assert kept.read("stages/fit.json", "a record") is None
    outcome = perform(far, lambda _: None)
    assert outcome.failure == ""
    assert outcome.record.figures == {"strands": 200.0, "steps": 6.0}
    for name in ("run/groom.npz", "run/model/model.safetensors"):
        assert kept.read(name, "a result") == (tmp_path / "out" / "near" / name).read_bytes()
    assert kept.read("inputs/capture/transforms.json", "a file") is None
    assert os.environ["AWS_ENDPOINT_URL"].startswith("http://127.0.0.1")


def test_faults_of_the_program_are_kept_beside_the_results(tmp_path, monkeypatch):
    from neural_strands.batch import stages

    def broken(work):
        raise ZeroDivisionError("by nothing")

    monkeypatch.setattr(stages, "WORK", {"lmvs": broken})
    subject = read_subjects(write_subjects(tmp_path / "s.toml", {"bob": {"capture": "ball"}})).subjects[0]
    outcome = perform(Task(subject, "lmvs", str(tmp_path), Demand(cores=1, gpu=0.0)), lambda _: None)
    assert outcome.failure == ("a fault of the program (ZeroDivisionError: by nothing); see stages/lmvs.error.txt.")
    assert "ZeroDivisionError" in (tmp_path / "bob" / "stages" / "lmvs.error.txt").read_text()


def test_another_version_on_a_node_is_one_sentence(tmp_path):
    subject = read_subjects(write_subjects(tmp_path / "s.toml", {"bob": {"capture": "ball"}})).subjects[0]
    task = Task(subject, "lmvs", str(tmp_path), Demand(cores=1, gpu=0.0), version="0")
    assert "expected neural-strands 0, found" in perform(task, lambda _: None).failure
