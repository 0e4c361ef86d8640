from pathlib import Path

import pytest

from neural_strands.viewer.panels.tabs import title


@pytest.mark.parametrize(
    ("path", "expected"), [("/data/anna/run", "anna/run"), ("/run", "run"), ("/", ""), ("/a/b/hair.usd", "b/hair.usd")]
)
def test_a_page_is_called_by_the_last_two_parts_of_its_path(path, expected):
    assert title(Path(path)) == expected


def test_a_relative_path_counts_from_the_working_directory(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert title(Path("run")) == f"{tmp_path.name}/run"
