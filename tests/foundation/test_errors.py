import pytest

from neural_strands.foundation.errors import LONGEST_EXCERPT, LONGEST_REASON, excerpt, reason

NESTED: list = []
for _ in range(900):
    NESTED = [NESTED]


@pytest.mark.parametrize(
    "content",
    ["a" * 35_000, b"\x00\xff" * 10_000, "\x1b[31m\n\r\u2028\ud800", 10**4000, list(range(10**6)), NESTED, None, 1.5],
)
def test_an_excerpt_is_one_short_printable_line(content):
    quoted = excerpt(content)
    assert 0 < len(quoted) <= LONGEST_EXCERPT
    assert quoted.isprintable()


def test_short_content_is_quoted_whole():
    assert excerpt("wide") == "'wide'"
    assert excerpt(["a", 1]) == "['a', 1]"
    assert excerpt(None) == "None"


def test_a_reason_is_one_short_printable_line():
    assert reason(OSError(13, "Permission denied", "a")) == "Permission denied"
    assert reason(ValueError("two\nlines\tand \x07")) == "two lines and ?"
    assert reason(KeyError()) == "KeyError"
    assert len(reason(ValueError("x" * 35_000))) == LONGEST_REASON
