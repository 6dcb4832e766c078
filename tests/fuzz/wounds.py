# SPDX-License-Identifier: GPL-3.0-or-later
"""How sound files are broken for `tests.fuzz`: in their bytes, and in the structure that their format has."""

import base64
import contextlib
import json
import random
import re
import struct
import zlib
from copy import deepcopy
from functools import cache

from addon.io.packing import DIGEST, _digest
from tests.io.qtm_file import compound_file, packed_series, streams, unpacked_series
from tests.io.samples import capture

from .streams import KINDS as STREAMS
from .streams import other_packets

TOKENS = [
    b"nan", b"inf", b"-1e999", b"1e308", b"0", b"-1", b"999999999999", b"", b",", b"\n", b'"', b"'", b"\0", b"\xff\xfe",
    b"[", b"]", b"{", b"}", b"<", b">", b"/>", b":", b"- ", b"  ", b"\t", b"\r", b"\xe2\x82\xac", b"true", b"null",
    b"65536", b"\x7f", b"_", b"1_0", b"1e400", b"&amp;", b"!!opencv-matrix", b"#", b"%", b"=", b"\\ud800", b"\\u0000",
    b"\xe2\x80\xa8", b"4294967296", b"1e-320", b"-0", b"\xd9\xa3", b"0x10", b"1d5", b"1,5", b"+-1", b"1e", b"-nan(7)",
    b"9" * 5000, b"1e200", b"-1e-200", b"9223372036854775808", b"..", b"/", b"../../etc/passwd", b"\x1b[2J",
    b"\xc2\x85", b"*", b"|", b"#N/A", b".", b"-", b"&#0;", b"&#xD800;", b"'''", b'"""', b"1979-05-27T07:32:00Z",
    b"!!python/object:x",
]  # fmt: skip
VALUES = [
    None, True, -1, 0, 1e308, -1e-308, 10**30, float("nan"), float("inf"), "", "x", "a\ud800", "a\0", [], {}, 10**400,
    1e200, "\x1b[2J", "a\nb", "x" * 100_000, [[]], {"": 0}, 0.5, -7, 2**31, 2**63, [None], "../../x",
]  # fmt: skip
WORDS = [0, 1, 2, 0x7F, 0x80, 0xFF, 0x100, 0x7FFF, 0x8000, 0xFFFE, 0xFFFF]
INF = float("inf")
REALS = [float("nan"), INF, -INF, 0.0, -0.0, -1.0, 1e-40, 3.4e38, -3.4e38, 1e19, 65535.0, -(2.0**31)]
LONGS = [0, 1, 2, 5, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 0xFFFFFFFE, 0xFFFFFFFD, 65536, 1 << 20]
LETTERS = 20_000_000  # that a part may have that is there many times
OFTEN = 20_000
BINARY, JSON, XML = ("c3d", "dec", "mips"), ("markerset", "model", "history", "edits", "report"), ("xcp", "qca", "mcal")
WIDTHS = ["utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "utf-32", "cp1252", "cp037", "utf-7"]
LINE_ENDS = ["\r\n", "\r", "\n\n", "\v", "\f", "\x85", "\u2028", "\0", "\n\r", " \n", "\t\n", "\\\n"]
DEEP = {
    "xml": ("<a>", ""), "json": ("[", "]"), "json of names": ('{"a":', "}"), "toml": ("x = [", "]"),
    "dots": ("a.", "= 1"), "yaml": ("- ", ""), "flow": ("[", ""), "quotes": ('"', ""), "marks": ("<!--", ""),
}  # fmt: skip
DECLARED = [
    '<!DOCTYPE a [<!ENTITY b "cc"><!ENTITY d "&b;&b;&b;&b;">]>', '<!DOCTYPE a SYSTEM "file:///etc/passwd">',
    '<!DOCTYPE a [<!ENTITY e SYSTEM "http://localhost/">]>', "<![CDATA[ ]]>", "<?x y?>", "<!-- x -->", "&b;",
    '<?xml version="1.0" encoding="utf-32"?>', '<?xml version="9.9"?>', '<x xmlns="y"/>', 'xmlns:a="b" ', "<a:b/>",
    '<!doctype a [<!entity b "c">]>', '<!DOCTYPE a [<!ATTLIST a b CDATA "c">]>',
    '<a xmlns:xi="x"><xi:include href="y"/></a>',
]  # fmt: skip


def case(kind: str, contents: dict[str, bytes], seed: int, number: int) -> bytes:
    """The broken file of that number, of a kind; the others' sound contents are what it may be spliced with."""
    chance = random.Random(f"{kind} {seed} {number}")
    content = contents[kind]
    way = chance.random()
    if way < 0.4:
        return mutated(content, chance)
    if way < 0.9:
        return rebuilt(kind, content, chance)
    if way < 0.95:
        return mutated(rebuilt(kind, content, chance), chance)
    other = contents[chance.choice(sorted(contents))]
    return content[: chance.randrange(len(content) + 1)] + other[chance.randrange(len(other) + 1) :]


def mutated(content: bytes, chance: random.Random) -> bytes:
    """`content` with one to four wounds: cuts, other bytes, doubled parts, tokens that readers stumble over."""
    changed = bytearray(content)
    for _ in range(chance.randint(1, 4)):
        at, other = (chance.randrange(len(changed) + 1) for _ in range(2))
        size = chance.choice([0, 1, 5, 12, 40, 64, 512, 4096])
        parts = [b"", bytes([chance.randrange(256)]), changed[other : other + size], *[chance.choice(TOKENS)] * 2]
        size = chance.choice([0, 1, size, size if chance.random() < 0.8 else len(changed)])
        changed[at : at + size] = chance.choice(parts)
    return bytes(changed)


def rebuilt(kind: str, content: bytes, chance: random.Random) -> bytes:
    """`content` with one to three changes of its structure: values, fields, rows, elements or words of a header."""
    if kind == "qtm":
        return _other_parts(chance)
    if kind in STREAMS:
        return other_packets(content, chance)
    if kind in JSON:
        return _other_json(content, chance)
    for _ in range(chance.randint(1, 3)):
        if len(content) > LETTERS:
            break
        if kind in BINARY:
            content = _other_bytes(content, chance)
        elif chance.random() < 0.7:
            content = _other_fields(content, chance)
        else:
            content = _other_text(kind, content, chance)
    return content


def _times(letters: int, chance: random.Random) -> int:
    """How many more times a part of that many letters is there."""
    if chance.random() < 0.02 and letters * OFTEN < LETTERS:
        return OFTEN
    return chance.choice([1, 1, 3, 100 if letters * 100 < LETTERS else 1])


def _depth(chance: random.Random) -> int:
    return chance.choice([3, 30, 1100]) if chance.random() < 0.9 else 100_000


def _other_json(content: bytes, chance: random.Random) -> bytes:
    document = json.loads(content)
    for _ in range(chance.randint(1, 3)):
        document = _other_value(document, chance)
    if chance.random() < 0.7:
        digest_anew(document)
    text = json.dumps(document, ensure_ascii=chance.random() < 0.8)
    if chance.random() < 0.1 and '"' in text:  # a name that is there twice
        parts = text.split(", ")
        parts.insert(chance.randrange(len(parts)), chance.choice(parts))
        text = ", ".join(parts)
    if chance.random() < 0.03:
        opening, closing = DEEP[chance.choice(["json", "json of names"])]
        depth = _depth(chance)
        text = text.replace("0", opening * depth + "0" + closing * depth, 1)
    if chance.random() < 0.03:
        return text.encode(chance.choice(WIDTHS), "replace")
    return text.encode("utf-8", "surrogatepass")


def _other_value(document: object, chance: random.Random) -> object:
    """A document with a value gone, there many times, exchanged for another one's, or another."""
    holder, key = None, None
    node = document
    for _ in range(chance.choice([1, 2, 3, 4, 5, 6, 8, 12])):
        if not isinstance(node, (dict, list)) or not node:
            break
        holder, key = node, chance.choice(list(node) if isinstance(node, dict) else range(len(node)))
        node = holder[key]
    way = chance.randrange(6)
    if holder is None:
        return deepcopy(chance.choice(VALUES))
    if way == 0:
        del holder[key]
    elif way == 1 and isinstance(holder, list):
        letters = len(json.dumps(node))
        holder[key:key] = [node] * _times(letters, chance)
    elif way == 2 and isinstance(holder, dict):
        holder[chance.choice(list(holder))] = deepcopy(node)
    elif way == 3 and isinstance(node, (int, float)) and not isinstance(node, bool):
        with contextlib.suppress(OverflowError):
            others = [-node, node + 1, node - 1, node * 1e6, node * 1e-6, node * 10**9, str(node), [node]]
            holder[key] = chance.choice(others)
    elif way == 4 and isinstance(holder.get("data") if isinstance(holder, dict) else None, str):
        _other_array(holder, chance)
    else:
        holder[key] = deepcopy(chance.choice(VALUES))
    return document


def _other_array(array: dict, chance: random.Random):
    """Other numbers in a packed array, of the same or another shape or kind."""
    try:
        data = bytearray(zlib.decompress(base64.b64decode(array["data"])))
    except (ValueError, zlib.error):
        return
    if data:
        size = chance.choice([1, 2, 4, 8])
        at = size * chance.randrange(max(len(data) // size, 1))
        wounds = [b"\xff" * size, b"\0" * size, b"\x7f" * size, bytes([chance.randrange(256)]) * size]
        wounds += [struct.pack("<f", chance.choice(REALS)), struct.pack("<d", chance.choice(REALS))]
        data[at : at + size] = chance.choice(wounds)[:size].ljust(size, b"\0")
    array["data"] = base64.b64encode(zlib.compress(bytes(data))).decode()
    if chance.random() < 0.3 and isinstance(array.get("shape"), list):
        array["shape"] = chance.choice([array["shape"][::-1], [len(data)], [0], [*array["shape"], 1], [10**9, 0], []])


def digest_anew(node: object):
    """Digests that fit again: else nobody looks at what is in there."""
    if isinstance(node, dict):
        for one in node.values():
            digest_anew(one)
        if DIGEST in node:
            with contextlib.suppress(ValueError, TypeError):
                node[DIGEST] = _digest({key: value for key, value in node.items() if key != DIGEST})
    elif isinstance(node, list):
        for one in node[:50]:
            digest_anew(one)


@cache
def _sound_parts() -> dict[str, bytes]:
    return streams(capture())


def _other_parts(chance: random.Random) -> bytes:
    """A capture with broken parts, some of them before they were packed, or a broken container around them."""
    parts = dict(_sound_parts())
    for _ in range(chance.randint(1, 3)):
        name = chance.choice(sorted(parts))
        index, way = f"{name}Index", chance.random()
        if index in parts and way < 0.4:
            content = unpacked_series(_sound_parts()[name], _sound_parts()[index])
            changed = bytearray(mutated(content, chance) if chance.random() < 0.5 else content)
            _place_word(changed, chance)
            parts[name], parts[index] = packed_series(bytes(changed))
            continue
        changed = bytearray(parts[name])
        _place_word(changed, chance)
        other, odd = parts[chance.choice(sorted(parts))], [b"", parts[name] * 50, bytes(1 << 16), b"\xff" * 4096]
        ways = [bytes(changed), bytes(changed), mutated(parts[name], chance), other, chance.choice(odd)]
        parts[name] = chance.choice(ways)
    if chance.random() < 0.1:
        del parts[chance.choice(sorted(parts))]
    content = bytearray(compound_file(parts, chance.choice([512, 512, 4096])))
    if chance.random() < 0.25:  # the container: its header, its tables and its directory are at both ends
        for _ in range(chance.randint(1, 3)):
            at = chance.choice([chance.randrange(76), chance.randrange(512), len(content) - chance.randrange(1, 2048)])
            at = max(at // 4 * 4, 0)
            content[at : at + 4] = chance.choice([*LONGS, chance.randrange(40)]).to_bytes(4, "little")
    return bytes(content)


def _place_word(content: bytearray, chance: random.Random):
    """Another number of 4 or 8 bytes somewhere."""
    at = 4 * chance.randrange(max(len(content) // 4, 1))
    if chance.random() < 0.7:
        content[at : at + 4] = chance.choice(LONGS).to_bytes(4, "little")
    else:
        content[at : at + 8] = struct.pack("<d", chance.choice(REALS))


def _other_bytes(content: bytes, chance: random.Random) -> bytes:
    """A C3D file with other bytes in its header, its parameters, near the name of one, or anywhere."""
    changed, names = bytearray(content), [found.span() for found in re.finditer(rb"[A-Z_]{4,}", content[512:4096])]
    for _ in range(chance.choice([1, 1, 1, 3, 40])):
        way = chance.randrange(4)
        if way == 0 and names:  # length, group, way on, type, sizes or values of a parameter
            start, end = chance.choice(names)
            at, part = 512 + chance.choice([start - 2, start - 1, *range(end, end + 12)]), _byte(chance)
        elif way == 1:
            at = 4 * chance.randrange(max(len(changed) // 4, 1))
            part = struct.pack(chance.choice("<>") + "f", chance.choice(REALS))
        else:
            at = 2 * chance.randrange(max(min(20 if chance.random() < 0.4 else 1024, len(changed) // 2 - 1), 1))
            word = chance.choice(WORDS).to_bytes(2, chance.choice(["little", "big"]))
            part = word if way == 2 else _byte(chance)
        changed[at : at + len(part)] = part
    return bytes(changed)


def _byte(chance: random.Random) -> bytes:
    return bytes([chance.choice([0, 1, 2, 3, 4, 7, 0x7F, 0x80, 0xFE, 0xFF, chance.randrange(256)])])


def _other_fields(content: bytes, chance: random.Random) -> bytes:
    """A text with another word, or with a part between separators gone, doubled or there many times."""
    text, encoding = _decoded(content)
    separator = chance.choice(["\n", "\n", ",", "\t", " ", ">", "]", '"', "="])
    parts = text.split(separator)
    at = chance.randrange(len(parts))
    way = chance.randrange(6)
    if way == 0:
        del parts[at : at + chance.choice([1, 1, 1, 5, 50])]
    elif way == 1:
        some = parts[at : at + chance.choice([1, 1, 4])]
        parts[at:at] = some * _times(sum(map(len, some)) + len(some), chance)
    elif way == 2:
        other = chance.randrange(len(parts))
        parts[at], parts[other] = parts[other], parts[at]
    else:
        words = list(re.finditer(r"[\w.+-]+", parts[at]))
        if words:
            word, token = chance.choice(words), chance.choice(TOKENS).decode("utf-8", "replace")
            parts[at] = parts[at][: word.start()] + token + parts[at][word.end() :]
    return separator.join(parts).encode(encoding, "replace")


def _other_text(kind: str, content: bytes, chance: random.Random) -> bytes:
    """A text of another encoding, with other line ends, a word without an end, a deep nest or a declaration."""
    text, encoding = _decoded(content)
    way = chance.randrange(6)
    if way == 0:
        return text.encode(chance.choice(WIDTHS), "replace")
    if way == 1:
        start = chance.randrange(len(text) + 1) if chance.random() < 0.3 else 0
        text = text[:start] + text[start:].replace("\n", chance.choice(LINE_ENDS))
    elif way == 2:
        at = chance.randrange(len(text) + 1)
        text = text[:at] + chance.choice("x0 9,\t\u0301") * chance.choice([300, 5000, 100_000]) + text[at:]
    elif way == 3:
        at = chance.choice([0, len(text), chance.randrange(len(text) + 1)])
        opening, closing = DEEP[chance.choice(sorted(DEEP))]
        depth = _depth(chance)
        text = text[:at] + opening * depth + "1" + closing * depth + text[at:]
    elif way == 4 and kind in XML:
        places = [0, *(found.start() for found in re.finditer("<", text))]
        at = chance.choice(places[:3] if chance.random() < 0.5 else places)
        text = text[:at] + chance.choice(DECLARED) + text[at:]
    else:
        numbers = list(re.finditer(r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?", text))
        some = chance.sample(numbers, min(len(numbers), chance.choice([1, 2, 30])))
        for found in sorted(some, key=lambda one: -one.start()):
            power = chance.choice([3, -3, 9, 160, 308, -320])
            other = chance.choice([f"{found[0]}e{power}", f"-{found[0]}", "0", "1", found[0] * 2])
            text = text[: found.start()] + other + text[found.end() :]
    return text.encode(encoding, "replace")


def _decoded(content: bytes) -> tuple[str, str]:
    if content[:2] == b"\xff\xfe":
        return content.decode("utf-16", "replace"), "utf-16"
    return content.decode("latin-1"), "latin-1"
