"""Files are written completely or not at all."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from read_only import read_only_folder

from neural_strands.foundation.errors import InputError
from neural_strands.foundation.files import (
    atomic_file,
    atomic_folder,
    check_folder_writable,
    check_writable,
    is_taken,
    sole_writer,
)


def test_file_appears_whole_and_replaces(tmp_path: Path):
    target = tmp_path / "deep" / "a.txt"
    for content in ("first", "second"):
        with atomic_file(target) as temporary:
            assert temporary.suffix == ".txt"
            assert temporary.parent == target.parent
            temporary.write_text(content)
            assert not target.exists() or target.read_text() == "first"
        assert target.read_text() == content
    assert [path.name for path in target.parent.iterdir()] == ["a.txt"]


@pytest.mark.skipif(sys.platform == "win32", reason="Windows allows links only to administrators")
def test_a_file_is_written_through_links(tmp_path: Path):
    for name in ("store", "out"):
        (tmp_path / name).mkdir()
    kept, first, second, dangling = (tmp_path / name for name in ("store/kept.bin", "out/a.txt", "b.txt", "out/c.txt"))
    kept.write_text("old")
    first.symlink_to(Path("..") / "store" / "kept.bin")
    second.symlink_to(first)
    dangling.symlink_to(tmp_path / "new" / "made.txt")
    for link in (first, second):
        check_writable(link)
        with atomic_file(link) as temporary:
            assert (temporary.parent, temporary.suffix) == (kept.parent, ".txt")
            temporary.write_text(f"by {link.name}")
        assert link.is_symlink()
        assert not kept.is_symlink()
        assert kept.read_text() == f"by {link.name}"
    with atomic_file(dangling) as temporary:
        temporary.write_text("made")
    assert dangling.is_symlink()
    assert (tmp_path / "new" / "made.txt").read_text() == "made"
    with pytest.raises(KeyError), atomic_file(first) as temporary:  # noqa: PT012
        temporary.write_text("half")
        raise KeyError
    assert kept.read_text() == "by b.txt"
    assert sorted(path.name for path in tmp_path.rglob("*.*")) == ["a.txt", "b.txt", "c.txt", "kept.bin", "made.txt"]


def test_failed_file_leaves_the_old_one(tmp_path: Path):
    target = tmp_path / "a.txt"
    target.write_text("old")
    with pytest.raises(KeyError), atomic_file(target) as temporary:  # noqa: PT012
        temporary.write_text("half")
        raise KeyError
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_file_under_a_file_is_an_input_error(tmp_path: Path):
    (tmp_path / "a").write_text("")
    with pytest.raises(InputError, match="cannot be written"), atomic_file(tmp_path / "a" / "b.txt"):
        pass


def test_user_errors_pass_through_unchanged(tmp_path: Path):
    with pytest.raises(InputError, match=r"^mine$"), atomic_file(tmp_path / "a"):
        raise InputError("mine")


def test_folder_replaces_whole(tmp_path: Path):
    target = tmp_path / "out"
    for name in ("one", "two"):
        with atomic_folder(target) as temporary:
            (temporary / name).write_text(name)
    assert [path.name for path in target.iterdir()] == ["two"]
    assert list(tmp_path.iterdir()) == [target]


def test_failed_folder_leaves_the_old_one(tmp_path: Path):
    target = tmp_path / "out"
    target.mkdir()
    (target / "old").write_text("old")
    with pytest.raises(KeyError), atomic_folder(target) as temporary:  # noqa: PT012
        (temporary / "half").write_text("half")
        raise KeyError
    assert [path.name for path in target.iterdir()] == ["old"]
    assert list(tmp_path.iterdir()) == [target]


def test_folder_under_a_file_is_an_input_error(tmp_path: Path):
    (tmp_path / "a").write_text("")
    with pytest.raises(InputError, match="cannot be written"), atomic_folder(tmp_path / "a" / "b"):
        pass


WRITER = """
import sys, time
from pathlib import Path
from neural_strands.foundation.files import atomic_file, atomic_folder, sole_writer
folder = Path(sys.argv[1])
with sole_writer(folder), atomic_file(folder / "checkpoint.pt") as file, atomic_folder(folder / "model") as model:
    file.write_text("half")
    (model / "weights").write_text("half")
    print("writing", flush=True)
    time.sleep(60)
"""


def test_a_folder_has_one_writer_and_a_killed_one_leaves_nothing(tmp_path: Path):
    folder = tmp_path / "run"
    other = subprocess.Popen([sys.executable, "-c", WRITER, str(folder)], stdout=subprocess.PIPE, text=True)
    assert other.stdout.readline() == "writing\n"
    with pytest.raises(InputError, match="expected a folder that no other process writes to"), sole_writer(folder):
        pass
    other.kill()
    other.communicate()
    assert len(list(folder.iterdir())) == 3
    (folder / ".hidden").write_text("the user's own")
    with sole_writer(folder):
        assert sorted(path.name for path in folder.iterdir()) == [".hidden", ".in_use"]
    assert [path.name for path in folder.iterdir()] == [".hidden"]


REPLACER = """
import sys, time
from pathlib import Path
from neural_strands.foundation.files import atomic_folder
rename = Path.replace
def rename_and_wait(path, target):
    renamed = rename(path, target)
    print("renamed", flush=True)
    time.sleep(60)
    return renamed
Path.replace = rename_and_wait
with atomic_folder(Path(sys.argv[1])) as model:
    (model / "weights").write_text("new")
"""


@pytest.fixture
def killed_between_the_renames(tmp_path: Path) -> Path:
    """A folder whose old contents have been set aside by a process that was killed before it renamed the new ones."""
    folder = tmp_path / "run" / "model"
    folder.mkdir(parents=True)
    (folder / "weights").write_text("old")
    other = subprocess.Popen([sys.executable, "-c", REPLACER, str(folder)], stdout=subprocess.PIPE, text=True)
    assert other.stdout.readline() == "renamed\n"
    other.kill()
    other.communicate()
    assert not folder.exists()
    assert len(list(folder.parent.iterdir())) == 2
    return folder


def test_the_next_writer_of_the_run_puts_back_what_was_set_aside(killed_between_the_renames: Path):
    folder = killed_between_the_renames
    with sole_writer(folder.parent):
        assert sorted(path.name for path in folder.parent.iterdir()) == [".in_use", "model"]
        assert (folder / "weights").read_text() == "old"


def test_the_next_writer_of_the_folder_puts_back_what_was_set_aside(killed_between_the_renames: Path):
    folder = killed_between_the_renames
    with pytest.raises(KeyError), atomic_folder(folder):
        raise KeyError
    assert (folder / "weights").read_text() == "old"


def test_what_was_set_aside_last_is_put_back_and_the_rest_removed(tmp_path: Path):
    for age, name in ((0, ".model.0123abcd.old"), (2, ".model.4567abcd.old"), (1, ".model.89ababcd.old")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "weights").write_text(name)
        os.utime(tmp_path / name, (1e9 - age, 1e9 - age))
    (tmp_path / ".groom.0123abcd.old").write_text("a temporary file of groom.old")
    with sole_writer(tmp_path):
        assert sorted(path.name for path in tmp_path.iterdir()) == [".in_use", "model"]
    assert (tmp_path / "model" / "weights").read_text() == ".model.0123abcd.old"


def test_a_rename_that_fails_leaves_the_old_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    folder, rename = tmp_path / "model", Path.replace
    folder.mkdir()
    (folder / "weights").write_text("old")

    def fail_onto_the_target(path: Path, target: Path) -> Path:
        if target == folder:
            raise PermissionError
        return rename(path, target)

    monkeypatch.setattr(Path, "replace", fail_onto_the_target)
    with pytest.raises(InputError, match="nothing was changed"), atomic_folder(folder) as temporary:
        (temporary / "weights").write_text("new")
    assert (folder / "weights").read_text() == "old"
    assert list(tmp_path.iterdir()) == [folder]


@pytest.mark.skipif(sys.platform == "win32", reason="Windows allows links only to administrators")
def test_a_folder_is_replaced_through_a_link(tmp_path: Path):
    (tmp_path / "large disk" / "kept").mkdir(parents=True)
    (tmp_path / "large disk" / "kept" / "old").touch()
    link = tmp_path / "model"
    link.symlink_to(tmp_path / "large disk" / "kept")
    with atomic_folder(link) as temporary:
        (temporary / "new").touch()
    assert link.is_symlink()
    assert [path.name for path in link.iterdir()] == ["new"]
    assert [path.name for path in (tmp_path / "large disk").iterdir()] == ["kept"]


def test_a_writer_that_wrote_nothing_leaves_no_folder(tmp_path: Path):
    for _ in range(2):
        with sole_writer(tmp_path / "deep" / "run"):
            assert (tmp_path / "deep" / "run").is_dir()
        assert list(tmp_path.iterdir()) == []
    with pytest.raises(KeyError), sole_writer(tmp_path / "deep" / "run"):
        raise KeyError
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "a").write_text("")
    with pytest.raises(InputError, match="cannot be written"), sole_writer(tmp_path / "a" / "b"):
        pass


def test_what_can_be_written_is_not_touched_by_the_check(tmp_path: Path):
    (tmp_path / "a.txt").write_text("old")
    check_writable(tmp_path / "a.txt")
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]
    assert (tmp_path / "a.txt").read_text() == "old"
    check_writable(tmp_path / "new" / "b.txt")
    assert list((tmp_path / "new").iterdir()) == []
    with pytest.raises(InputError, match=r"out.txt: cannot be written \(.+\); nothing was changed"):
        check_writable(read_only_folder(tmp_path / "read-only") / "out.txt")


def test_a_folder_that_can_be_written_is_not_created_by_the_check(tmp_path: Path):
    check_folder_writable(tmp_path)
    check_folder_writable(tmp_path / "new" / "deeper")
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=r"file/run: cannot be written \(.+\); nothing was changed"):
        check_folder_writable(tmp_path / "file" / "run")
    with pytest.raises(InputError, match=r"deep/out: cannot be written \(.+\); nothing was changed"):
        check_folder_writable(read_only_folder(tmp_path / "read-only") / "deep" / "out")


def test_a_place_is_taken_by_whatever_a_user_put_there(tmp_path: Path):
    assert not is_taken(tmp_path / "absent")
    assert not is_taken(tmp_path)
    (tmp_path / ".DS_Store").touch()
    assert not is_taken(tmp_path)
    (tmp_path / ".hidden").touch()
    assert is_taken(tmp_path)
    assert is_taken(tmp_path / ".hidden")
