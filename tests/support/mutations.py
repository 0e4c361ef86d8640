"""Damage to whole files from a seed: blind edits of bytes, and edits that keep the container's own checks intact.

An archive whose checksum no longer fits is refused at the door. So archives, pictures, videos and safetensors are also
taken apart, damaged inside, and put together again with checksums and lengths that fit.
"""

import io
import json
import re
import struct
import zipfile
import zlib
from random import Random
from typing import Any

from media_mutations import BOXES, JPEG, damaged_boxes, damaged_jpeg

NUMBER = re.compile(rb"-?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")
CLAIMS = [
    0,
    1,
    0xFF,
    0x7FFF,
    0xFFFF,
    0x7FFFFFFF,
    0x80000000,
    0xFFFFFFFF,
    0x7FC00000,
    2**40,
    2**62,
    2**63 - 1,
    2**64 - 1,
]
"""Counts and a NaN with which a binary field may be overwritten."""
WORDS = [b"4000000000", b"-1", b"0", b"nan", b"inf", b"1e999", b"1e-320", b"", b"l", b"/", b"null", b'"', b"[", b"{"]
"""Text in place of a number."""
ODD_VALUES: list[Any] = [
    None,
    True,
    0,
    -1,
    1,
    2**31,
    2**63,
    2**64,
    10**400,
    1e300,
    -1e-300,
    "",
    "x",
    "/",
    "../..",
    "\0",
    "\ud800",
    "a" * 300,
    [],
    {},
    [None],
    [[]],
    [1, 2, 3],
    {"": None},
]
"""JSON in place of other JSON."""
PNG, ZIP, NESTING = b"\x89PNG\r\n\x1a\n", b"PK\x03\x04", 3000


def mutated(random: Random, content: bytes) -> bytes:
    """The content with one to four edits, of its bytes or of what its container holds."""
    if random.random() < 0.35:
        return _edited(random, content)
    if content.startswith(ZIP):
        return _archive(random, content)
    if content.startswith(PNG):
        return _picture(random, content)
    if content.startswith(JPEG):
        return damaged_jpeg(random, content, _edited)
    if content[4:8] == BOXES:
        return damaged_boxes(random, content, _edited)
    if content[8:9] == b"{" and len(content) > 8 and int.from_bytes(content[:8], "little") < len(content):
        return _tensors(random, content)
    if content.lstrip()[:1] in (b"{", b"["):
        return _document(random, content)
    return _edited(random, content)


def _edited(random: Random, content: bytes) -> bytes:
    """Blind edits, none of which needs to know the format."""
    for _ in range(1 + min(3, int(random.expovariate(1.0)))):
        content = random.choice(EDITS)(random, content)
    return content


def _place(random: Random, content: bytes) -> int:
    """A position, in the first 200 bytes half of the time: headers matter most."""
    return random.randrange(min(len(content), 200) + 1) if random.random() < 0.5 else random.randrange(len(content) + 1)


def _flip(random: Random, content: bytes) -> bytes:
    at = _place(random, content)
    return (
        content[:at] + bytes([content[at] ^ 1 << random.randrange(8)]) + content[at + 1 :] if at < len(content) else b""
    )


def _replace(random: Random, content: bytes) -> bytes:
    at, new = _place(random, content), random.randbytes(random.randint(1, 8))
    return content[:at] + new + content[at + len(new) :]


def _insert(random: Random, content: bytes) -> bytes:
    at = _place(random, content)
    return content[:at] + random.randbytes(random.randint(1, 8)) + content[at:]


def _remove(random: Random, content: bytes) -> bytes:
    at = _place(random, content)
    return content[:at] + content[at + random.randint(1, 40) :]


def _repeat(random: Random, content: bytes) -> bytes:
    at, length = _place(random, content), random.randint(1, 200)
    return content[: at + length] + content[at : at + length] * random.choice([1, 1, 2, 50]) + content[at + length :]


def _cut(random: Random, content: bytes) -> bytes:
    return content[: _place(random, content)]


def _claim(random: Random, content: bytes) -> bytes:
    at, width = _place(random, content), random.choice([2, 4, 4, 8])
    value = random.choice(CLAIMS) & (1 << 8 * width) - 1
    return content[:at] + value.to_bytes(width, random.choice(["little", "big"])) + content[at + width :]


def _number(random: Random, content: bytes) -> bytes:
    """One of the numbers in a text is replaced by another, or by something else."""
    start = _place(random, content)
    found = NUMBER.search(content, start) or NUMBER.search(content)
    if found is None:
        return content
    return content[: found.start()] + random.choice(WORDS) + content[found.end() :]


def _swap_lines(random: Random, content: bytes) -> bytes:
    lines = content.split(b"\n")
    if len(lines) > 5000:
        return _flip(random, content)
    first, second = random.randrange(len(lines)), random.randrange(len(lines))
    lines[first], lines[second] = lines[second], random.choice([lines[first], b"", lines[first] * 2])
    return b"\n".join(lines)


EDITS = [_flip, _replace, _insert, _remove, _repeat, _cut, _claim, _number, _swap_lines]
"""The blind edits."""


def _document(random: Random, content: bytes) -> bytes:
    """JSON with some of its values replaced, removed or wrapped."""
    try:
        document = json.loads(content)
    except ValueError:
        return _edited(random, content)
    for _ in range(random.randint(1, 3)):
        document = _changed(random, document)
    if random.random() < 0.01:
        return b"[" * NESTING + json.dumps(document).encode() + b"]" * NESTING
    return json.dumps(document).encode()


def _changed(random: Random, document: Any) -> Any:
    """A document with one odd value, at a random depth."""
    if not isinstance(document, dict | list) or not document or random.random() < 0.15:
        return random.choice([*ODD_VALUES, [document] * 3])
    keys = list(document) if isinstance(document, dict) else range(len(document))
    key, choice = random.choice(keys), random.random()
    if choice < 0.1:
        if isinstance(document, dict):
            return {name: value for name, value in document.items() if name != key}
        return [value for place, value in enumerate(document) if place != key]
    if choice < 0.15 and isinstance(document, dict):
        return {**document, random.choice(["", "x", key * 2]): document[key]}
    if choice < 0.15:
        return [*document, document[key]]
    document = dict(document) if isinstance(document, dict) else list(document)
    document[key] = _changed(random, document[key])
    return document


def _archive(random: Random, content: bytes) -> bytes:
    """A zip archive with one member damaged, removed or doubled, and a matching checksum."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            members = [(info, archive.read(info)) for info in archive.infolist()]
    except (zipfile.BadZipFile, ValueError, OSError):
        return _edited(random, content)
    at, choice = random.randrange(len(members)), random.random()
    info, inside = members[at]
    if choice < 0.05:
        del members[at]
    else:
        members[at] = (info, _edited(random, inside))
    written = io.BytesIO()
    with zipfile.ZipFile(written, "w") as archive:
        for each, data in members:
            # A member without a date would get the present one.
            archive.writestr(zipfile.ZipInfo(each.filename), data, each.compress_type)
    return written.getvalue()


def _picture(random: Random, content: bytes) -> bytes:
    """A PNG with one chunk damaged and a matching checksum."""
    chunks, at = [], len(PNG)
    while at + 12 <= len(content):
        (length,) = struct.unpack_from(">I", content, at)
        chunks.append((content[at + 4 : at + 8], content[at + 8 : at + 8 + length]))
        at += 12 + length
    place = random.choice([0, random.randrange(len(chunks))])
    kind, data = chunks[place]
    chunks[place] = (kind, _edited(random, data))
    parts = [struct.pack(">I", len(d)) + k + d + struct.pack(">I", zlib.crc32(k + d)) for k, d in chunks]
    return PNG + b"".join(parts)


def _tensors(random: Random, content: bytes) -> bytes:
    """Safetensors with a damaged header or damaged numbers, and a matching length."""
    length = int.from_bytes(content[:8], "little")
    header, numbers = content[8 : 8 + length], content[8 + length :]
    if random.random() < 0.5:
        header = _document(random, header)
    else:
        numbers = _edited(random, numbers)
    return len(header).to_bytes(8, "little") + header + numbers
