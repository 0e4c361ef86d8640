"""Config dataclasses: round trips through `asdict` and JSON, and one sentence for everything else."""

import json
from dataclasses import asdict, dataclass, field
from typing import Annotated, Literal

import pytest

from neural_strands.foundation.configs import Between, check_config, config_from_json, read_settings
from neural_strands.foundation.errors import InputError
from neural_strands.foundation.json_files import JsonValue


@dataclass(frozen=True)
class Inner:
    widths: Annotated[tuple[Annotated[int, Between(1, 8)], ...], Between(1, 3)] = (4, 4)
    up: tuple[float, float, float] = (0.0, 1.0, 0.0)


@dataclass(frozen=True)
class Outer:
    size: Annotated[int, Between(1, 64)] = 8
    share: Annotated[float, Between(0.0, 1.0)] = 0.5
    kind: Literal["one", "two"] = "one"
    flag: bool = True
    name: str = "a"
    limit: int | None = None
    seed: int = 0
    inner: Inner = field(default_factory=Inner)
    parts: tuple[Inner, ...] = ()

    def __post_init__(self) -> None:
        if self.size % 2:
            raise ValueError("size is odd")


@pytest.mark.parametrize(
    "config",
    [
        Outer(),
        Outer(size=64, share=1.0, kind="two", flag=False, name="ä", limit=3, seed=2**40),
        Outer(inner=Inner(widths=(1,), up=(0.0, 0.0, 1.0)), parts=(Inner(), Inner(widths=(8, 8, 8)))),
    ],
)
def test_a_config_comes_back(config: Outer):
    assert config_from_json(Outer, JsonValue(json.loads(json.dumps(asdict(config))), "a.json")) == config


def test_a_missing_field_takes_its_default():
    assert config_from_json(Outer, JsonValue({"size": 2}, "a.json")) == Outer(size=2)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"size": 65}, "size: expected a whole number from 1 to 64, found 65"),
        ({"size": 2**63}, "size: expected a whole number from 1 to 64"),
        ({"size": True}, "size: expected a whole number"),
        ({"size": 3}, "size is odd"),
        ({"share": "x"}, "share: expected a finite number"),
        ({"share": 10**400}, "share: expected a finite number"),
        ({"kind": "three"}, "kind: expected one of one, two"),
        ({"kind": ["one"]}, "kind: expected one of one, two"),
        ({"flag": 1}, "flag: expected true or false"),
        ({"name": 5}, "name: expected a text"),
        ({"limit": "x"}, "limit: expected a whole number"),
        ({"seed": 2**64}, "seed: expected a whole number"),
        ({"inner": []}, "inner: expected an object"),
        ({"inner": {"widths": []}}, r"inner\.widths: expected a list of 1 to 3 elements"),
        ({"inner": {"widths": [9]}}, r"inner\.widths\[0\]: expected a whole number from 1 to 8"),
        ({"inner": {"up": [0, 1]}}, r"inner\.up: expected a list of 3 elements"),
        ({"parts": [{"size": 1}]}, r"parts\[0\]\.size: expected a setting that Inner has"),
        ({"parts": [{}] * 65}, "parts: expected a list of 0 to 64 elements"),
        ([], "expected an object"),
    ],
)
def test_what_is_wrong_is_one_sentence(values, message):
    with pytest.raises(InputError, match=message) as caught:
        config_from_json(Outer, JsonValue(values, "a.json", advice="fit anew"))
    assert str(caught.value).startswith("a.json: ")
    assert str(caught.value).endswith("; fit anew.")


def test_only_plain_fields_are_taken():
    @dataclass(frozen=True)
    class Odd:
        folder: bytes = b""

    with pytest.raises(TypeError, match="bytes"):
        config_from_json(Odd, JsonValue({"folder": "a"}, "a.json"))


def test_what_a_document_leaves_out_stays_as_in_the_base():
    base = Outer(size=4, share=0.25, inner=Inner(widths=(1, 2), up=(1.0, 0.0, 0.0)))
    changed = config_from_json(base, JsonValue({"share": 1, "inner": {"widths": [8]}}, "a.json"))
    assert changed == Outer(size=4, share=1.0, inner=Inner(widths=(8,), up=(1.0, 0.0, 0.0)))


def test_a_config_made_in_python_is_held_to_the_same_bounds():
    check_config(Outer(parts=(Inner(),)), "config")
    for config, message in (
        (Outer(size=66), "config: size: expected a whole number from 1 to 64, found 66"),
        (Outer(share=float("nan")), "config: share: expected a finite number from 0.0 to 1.0, found nan"),
        (Outer(inner=Inner(widths=())), "config: inner.widths: expected a list of 1 to 3 elements"),
    ):
        with pytest.raises(InputError) as caught:
            check_config(config, "config")
        assert str(caught.value).startswith(message)


def test_toml_and_json_say_the_same(tmp_path):
    (tmp_path / "a.toml").write_text('size = 2\nkind = "two"\n[inner]\nwidths = [1, 2]\n')
    (tmp_path / "a.json").write_text(json.dumps({"size": 2, "kind": "two", "inner": {"widths": [1, 2]}}))
    configs = {config_from_json(Outer, read_settings(tmp_path / name)) for name in ("a.toml", "a.json")}
    assert configs == {Outer(size=2, kind="two", inner=Inner(widths=(1, 2)))}
    for content in ("size = ", "a" * 2_000_000, "x = " + "[" * 50_000):
        (tmp_path / "a.toml").write_text(content)
        with pytest.raises(InputError):
            read_settings(tmp_path / "a.toml")
