# SPDX-License-Identifier: GPL-3.0-or-later
"""C3D files in every layout that the format allows, written here word by word, and what must be read of them.

Files are read as whole tables, every column with all of its frames: what lanes are compared with.
"""

import struct
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from addon.io.c3d.reading import open_c3d
from addon.io.samples import Samples

BLOCK = 512
INTEL, DEC, MIPS = 84, 85, 86
SCALE = 0.05


def dense(frames: int, count: int, parts: Iterable[Samples]) -> tuple[np.ndarray, np.ndarray]:
    """(T, P, 3) and (T, P), NaN where missing."""
    xyz, residual = np.full((frames, count, 3), np.nan), np.full((frames, count), np.nan)
    for part in parts:
        xyz[part.frame, part.column], residual[part.frame, part.column] = part.xyz, part.residual
    return xyz, residual


def read_c3d(path: Path, rate: float | None = None) -> SimpleNamespace:
    """What a C3D file says of its points, with `xyz` (T, P, 3) and `residual` (T, P) in the file's units."""
    with open_c3d(path, rate, everything=True) as head:
        xyz, residual = dense(head.frames, head.count, head.parts())
        return SimpleNamespace(**vars(head), xyz=xyz * head.scale[0], residual=residual * head.scale[1])


@dataclass(frozen=True)
class Layout:
    """What a file looks like; `words` are put in the header or the groups instead of what is true."""

    processor: int = INTEL
    real: bool = True
    frames: int = 7
    points: int = 3
    first: int = 1
    channels: int = 0
    samples: int = 0  # of each channel in a frame
    rate: float = 100.0
    residuals: str = "signed"  # or "unsigned": how a real says -1
    blocks: int | None = None  # of parameters, as the section's head counts them
    header: tuple[tuple[int, int], ...] = ()  # (index, word)
    said_frames: int | None = None
    said_points: int | None = None
    up: str = "+Z"
    padded: bool = True
    turns: int = 0  # rotations in a frame, behind the points, with the ratio 2
    lab: bool = False  # whether there is what a laboratory adds: plates, events, an angle as the last of the points

    @property
    def order(self) -> str:
        return ">" if self.processor == MIPS else "<"

    def take(self) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates (T, P, 3) mm and fourth words (T, P): residual in the low byte, cameras in the high one."""
        rng = np.random.default_rng(self.frames + self.points)
        xyz = np.round(rng.uniform(-1500, 1500, (self.frames, self.points, 3)) / SCALE) * SCALE
        xyz += 0.0  # no DEC has a zero below zero
        word = rng.integers(0, 128, xyz.shape[:2]) * 256 + rng.integers(0, 256, xyz.shape[:2])
        word[1::3, 0] = -1
        return xyz, word

    def labels(self) -> list[str]:
        return [f"P{index:04d}" for index in range(self.points)]

    def content(self, xyz: np.ndarray | None = None) -> bytes:
        """The file, with points `xyz` (T, P, 3) mm instead of its own."""
        own, word = self.take()
        xyz = own if xyz is None else xyz
        section = self._section(0)
        blocks = -(-len(section) // BLOCK)
        data = self._data(xyz, word)
        if self.padded:
            data += bytes(-len(data) % BLOCK)
        section = self._section(2 + blocks, 2 + blocks + len(data) // BLOCK).ljust(blocks * BLOCK, b"\0")
        head = bytes([1, 80, blocks if self.blocks is None else self.blocks, self.processor])
        if self.turns:
            data += self.reals(np.arange(34 * self.turns * self.frames) / 8)
            data += bytes(-len(data) % BLOCK)
        return self._header(2 + blocks) + head + section[4:] + data

    def _header(self, start: int) -> bytes:
        last = self.first + self.frames - 1
        words = [self.points, self.channels * self.samples, min(self.first, 65535), min(last, 65535), 0]
        pack = struct.Struct(f"{self.order}5H").pack(*words)
        tail = struct.pack(f"{self.order}2H", start, self.samples)
        content = bytes([2, 80]) + pack + self.reals([self.scale]) + tail + self.reals([self.rate])
        content = bytearray(content.ljust(BLOCK, b"\0"))
        if self.lab:
            struct.pack_into(f"{self.order}HH", content, 298, 12345, 2)
            content[304:312] = self.reals([0.015, 0.04])
            content[376:379], content[396:404] = b"\0\1\0", b"RHS RTO "
        for index, word in self.header:
            struct.pack_into(f"{self.order}H", content, 2 * index, word)
        return bytes(content)

    @property
    def scale(self) -> float:
        return -SCALE if self.real else SCALE

    def reals(self, values) -> bytes:
        values = np.asarray(values, dtype=np.float32)
        if self.processor != DEC:
            return values.astype(f"{self.order}f4").tobytes()
        return (values * np.float32(4)).astype("<f4").view("<u2").reshape(-1, 2)[:, ::-1].tobytes()

    def _data(self, xyz, word) -> bytes:
        last = word if self.residuals == "signed" else word % 65536
        whole = np.concatenate([xyz / (1 if self.real else SCALE), last[..., None]], axis=2).reshape(len(xyz), -1)
        analog = np.arange(len(xyz) * self.channels * self.samples).reshape(len(xyz), -1) * 977 % 60_000 - 30_000
        analog = analog + 0.125 * self.real
        frame = np.concatenate([whole, analog], axis=1)
        return self.reals(frame.ravel()) if self.real else np.rint(frame).astype(f"{self.order}i2").tobytes()

    def _section(self, start: int, turns_start: int = 0) -> bytes:
        last = self.first + self.frames - 1
        frames = self.frames if self.said_frames is None else self.said_frames
        records = [
            self._group("POINT", 1),
            self._words("USED", 1, self.points if self.said_points is None else self.said_points),
            self._record("SCALE", 1, 4, (), self.reals([self.scale])),
            self._record("RATE", 1, 4, (), self.reals([self.rate])),
            self._words("DATA_START", 1, start),
            self._words("FRAMES", 1, min(frames, 65535)),
            self._texts("UNITS", 1, ["mm"]),
            self._texts("Y_SCREEN", 1, [self.up]),
        ]
        if frames > 65535:
            records.append(self._record("LONG_FRAMES", 1, 4, (), self.reals([frames])))
        for part in range(0, self.points, 255):
            number, labels = part // 255 + 1 if part else "", self.labels()[part : part + 255]
            records.append(self._texts(f"LABELS{number}", 1, labels))
            if self.lab:
                records.append(self._texts(f"DESCRIPTIONS{number}", 1, [f"of {label}" for label in labels]))
        records += [
            self._group("ANALOG", 2),
            self._words("USED", 2, self.channels),
            self._record("RATE", 2, 4, (), self.reals([self.rate * self.samples])),
            self._record("GEN_SCALE", 2, 4, (), self.reals([1])),
            self._record("SCALE", 2, 4, (self.channels,), self.reals([1] * self.channels)),
            self._record("OFFSET", 2, 2, (self.channels,), bytes(2 * self.channels)),
            self._texts("LABELS", 2, [f"A{index}" for index in range(self.channels)] or [""]),
            self._group("TRIAL", 3),
            *(self._lab() if self.lab else ()),
            *(self._turns(turns_start) if self.turns else ()),
        ]
        for name, number in (("ACTUAL_START_FIELD", self.first), ("ACTUAL_END_FIELD", last)):
            words = [number % 65536, number // 65536 % 65536]
            records.append(self._record(name, 3, 2, (2,), struct.pack(f"{self.order}2H", *words)))
        return bytes(4) + b"".join(records) + bytes(2)

    def _lab(self) -> list[bytes]:
        corner, times = np.array([[500, 400, 0], [0, 400, 0], [0, 0, 10], [500, 0, 10]]), [0, 0.5, 0, 1.25]
        corners, origins, matrix = np.stack([corner, corner - 600]), [1, -2, 40, 3, 4, -37], np.arange(36) % 7 - 3.0
        return [
            self._texts("ANGLES", 1, self.labels()[-1:]),
            self._group("FORCE_PLATFORM", 4),
            self._words("USED", 4, 2),
            self._record("TYPE", 4, 2, (2,), struct.pack(f"{self.order}2H", 2, 4)),
            self._record("CORNERS", 4, 4, (3, 4, 2), self.reals(corners.ravel())),
            self._record("ORIGIN", 4, 4, (3, 2), self.reals(origins)),
            self._record("CAL_MATRIX", 4, 4, (6, 6, 2), self.reals(np.tile(matrix, 2))),
            self._record("CHANNEL", 4, 2, (6, 2), struct.pack(f"{self.order}12H", *range(1, 13))),
            self._group("EVENT", 5),
            self._record("TIMES", 5, 4, (2, 2), self.reals(times)),
            self._texts("LABELS", 5, ["Foot Strike", "Foot Off"]),
            self._texts("CONTEXTS", 5, ["Left", "Right"]),
            self._group("OURS", -9, "a group that nobody knows"),
            self._record("bytes", -9, 1, (3,), bytes([1, 254, 7]), "three of them"),
            self._record("negative", 9, 2, (2,), struct.pack(f"{self.order}2h", -5, -32768)),
            self._group("SUBJECTS", 10),
            self._texts("NAMES", 10, ["Anna"]),
        ]

    def _turns(self, start: int) -> list[bytes]:
        words = {"USED": self.turns, "DATA_START": start, "RATIO": 2, "FRAMES": 2 * self.frames}
        labels = self._texts("LABELS", 11, [f"R{index}" for index in range(self.turns)])
        return [self._group("ROTATION", 11), *(self._words(name, 11, word) for name, word in words.items()), labels]

    def _group(self, name: str, group: int, words: str = "") -> bytes:
        """A group; one below zero is locked."""
        body = bytes([len(words)]) + words.encode()
        return self._head(name, -abs(group), group < 0) + struct.pack(f"{self.order}H", len(body) + 2) + body

    def _record(self, name: str, group: int, kind: int, dimensions: tuple, content: bytes, words: str = "") -> bytes:
        body = struct.pack("bB", kind, len(dimensions)) + bytes(dimensions) + content
        body += bytes([len(words)]) + words.encode()
        return self._head(name, abs(group), group < 0) + struct.pack(f"{self.order}H", len(body) + 2) + body

    def _head(self, name: str, group: int, locked: bool) -> bytes:
        return struct.pack("bb", -len(name) if locked else len(name), group) + name.encode()

    def _words(self, name: str, group: int, word: int) -> bytes:
        return self._record(name, group, 2, (), struct.pack(f"{self.order}H", word))

    def _texts(self, name: str, group: int, texts: list[str]) -> bytes:
        width = max(map(len, texts)) or 1
        content = "".join(text.ljust(width) for text in texts).encode()
        return self._record(name, group, -1, (width, len(texts)), content)
