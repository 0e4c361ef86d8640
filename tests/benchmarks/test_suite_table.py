"""The rows of the suite: all rows on disk are in the table, in the order of the cases, and their means are right."""

import json

import pytest


@pytest.fixture(scope="module")
def table(benchmark_module):
    return benchmark_module("quality", "suite_table")


@pytest.fixture
def stored(table, tmp_path):
    """A function that stores a row whose F at 2 mm is given, and the folder of the rows."""
    folder = tmp_path / "label"
    folder.mkdir()

    def store(case, seed, f_score, half="test"):
        shares = [[50.0, 5.0], [60.0, 6.0], [70.0, 7.0]]
        scores = [f_score - 10, f_score, f_score + 10]
        row = table.Row(case, half, seed, 1000 * (seed + 1), scores, shares, 10.0 + seed, [0.5, 1.0 + seed], 0.25)
        (folder / f"{case}_{seed}.json").write_text(json.dumps(table.asdict(row)))

    return store, folder


def cells(text, name):
    """The cells of the rows that begin with a name, split at two spaces or more."""
    lines = [[cell.strip() for cell in line.split("  ") if cell.strip()] for line in text.splitlines()]
    return [line for line in lines if line[0] == name]


def test_rows_are_in_the_order_of_the_cases_and_of_numbers(table, stored):
    store, folder = stored
    # Names of which one begins with another, and a seed of two digits.
    for case, seed in (("wavy_style_ict", 0), ("wavy_style", 10), ("wavy_style", 2), ("short_style", 0)):
        store(case, seed, 50.0)
    (folder / "settings.json").write_text("{}")
    (folder / "wavy_style_2.png").touch()
    found = [(row.case, row.half, row.seed) for row in table.read_rows(folder)]
    # Halves are those of the cases now, whatever was stored.
    assert found == [
        ("wavy_style", "tuning", 2),
        ("wavy_style", "tuning", 10),
        ("wavy_style_ict", "tuning", 0),
        ("short_style", "test", 0),
    ]


def test_every_case_counts_alike_and_the_worst_is_named(table, stored):
    """By hand: the means of long_waves and short_style at 2 mm are (40 + 50) / 2 and 30, their mean 37.5."""
    store, folder = stored
    store("long_waves", 0, 40.0)
    store("long_waves", 1, 50.0)
    store("short_style", 0, 30.0)
    text = table.write_results(folder)
    assert (folder.parent / "label.txt").read_text() == text
    assert cells(text, "long_waves")[-1] == [
        *("long_waves", "test", "mean", "1500", "35.0 / 45.0 / 55.0", "10.5", "0.50 / 1.50", "0.25", "60.0 / 6.0")
    ]
    (mean,) = cells(text, "mean of 2 of 6 cases")
    assert mean[1:6] == ["test", "all", "1250", "27.5 / 37.5 / 47.5", "10.2"]
    (worst,) = cells(text, "worst: short_style")
    assert worst[1:5] == ["test", "all", "1000", "20.0 / 30.0 / 40.0"]
    # 40 and 50 lie 5 from their mean: the deviation is the root of 2 * 25 / (2 - 1).
    assert text.splitlines()[-1] == "F's standard deviation over seeds, mean over cases: 7.07 / 7.07 / 7.07"
    rows = json.loads((folder.parent / "label.json").read_text())["rows"]
    assert [(row["case"], row["seed"]) for row in rows] == [("long_waves", 0), ("long_waves", 1), ("short_style", 0)]


def test_a_worse_seed_does_not_make_a_case_the_worst(table, stored):
    store, folder = stored
    store("long_waves", 0, 20.0)
    store("long_waves", 1, 60.0)
    store("short_style", 0, 30.0)
    store("wavy_long", 0, 5.0)
    text = table.write_results(folder)
    assert cells(text, "worst: short_style")
    tuning = sum(case.half == "tuning" for case in table.CASES)
    assert cells(text, f"mean of 1 of {tuning} cases")[0][1:5] == ["tuning", "all", "1000", "-5.0 / 5.0 / 15.0"]


def test_no_rows_and_single_seeds_have_no_spread(table, stored):
    store, folder = stored
    assert table.write_results(folder).splitlines()[0].split()[:3] == ["case", "half", "seed"]
    store("long_waves", 0, 40.0)
    text = table.write_results(folder)
    assert "deviation" not in text
    assert len(cells(text, "long_waves")) == 1


def test_rows_of_another_version_are_refused(table, stored):
    _, folder = stored
    (folder / "long_waves_0.json").write_text('{"case": "long_waves"}')
    with pytest.raises(SystemExit, match=r"long_waves_0\.json: expected the figures of this version"):
        table.read_rows(folder)
