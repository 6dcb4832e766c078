# SPDX-License-Identifier: GPL-3.0-or-later
"""Writes small Qualisys captures, `.qtm`, as the capture program lays them out: what the reader's tests start from."""

import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np
from lzallright import LZOCompressor

from addon.core.data.takes import Blobs
from addon.core.geometry.cameras import Cameras

SMALL, CUTOFF = 64, 4096
END, FREE, TABLE = 0xFFFFFFFE, 0xFFFFFFFF, 0xFFFFFFFD
INT, WORD16, WORD, LONG, REAL, FLAGS, BIT, ROW, PARTS = 3, 6, 7, 8, 10, 15, 16, 23, 24
POINT_TYPES = ("Normal", "Gap Filled", "Virtual", "Resampled", "Twin", "Linear Gap Fill", "Edited")
MEASURED, FILLED, EDITED = 1, 2, 64
BLOCK = 1000  # bytes: such that frames and samples go over from one block to the next


@dataclass
class Trajectory:
    """One trajectory: its label, ranges of frames, and a record (x, y, z, residual, type) in mm for each frame."""

    label: str
    ranges: list[tuple[int, int]]
    records: list[tuple[float, float, float, float, int]]
    discarded: bool = False


@dataclass
class Recording:
    """What a capture holds; `odd` replaces streams by their paths, None for one that is not there.

    uncalibrated, video  names of cameras without a calibration, and without blobs
    """

    cameras: Cameras
    blobs: Blobs | None = None
    trajectories: Sequence[Trajectory] = ()
    rate: float = 200.0
    uncalibrated: Sequence[str] = ()
    video: Sequence[str] = ()
    packing: int = 1
    lens_rest: float = 0.0
    odd: dict[str, bytes | None] = field(default_factory=dict)


def write_qtm(path: Path, recording: Recording, sector: int = 512) -> Path:
    path.write_bytes(compound_file({**streams(recording), **recording.odd}, sector))
    return path


def streams(recording: Recording) -> dict[str, bytes]:
    """The parts of the file by their paths."""
    schema = _Schema()
    found, series = {"Measurement NBC/Metadata": schema.metadata()}, {}
    found["Measurement NBC/Data Items"] = schema.root(recording, series)
    for number, content in series.items():
        packed, index = packed_series(content)
        found[f"Measurement NBC/Data series/{number}"] = packed
        found[f"Measurement NBC/Data series/{number}Index"] = index
    for number in range(len(recording.cameras)):
        found[f"Measurement/Cameras/Camera - {number + 1}"] = _camera(recording, number)
    return found


def packed_series(content: bytes) -> tuple[bytes, bytes]:
    packed, rows = b"", []
    for start in range(0, len(content), BLOCK):
        block = content[start : start + BLOCK]
        one = LZOCompressor().compress(block)
        rows.append(struct.pack("<QII", len(packed), len(one), len(block)))
        packed += one
    return packed, struct.pack("<I", len(rows)) + b"".join(rows)


def unpacked_series(packed: bytes, index: bytes) -> bytes:
    rows = np.frombuffer(index, "<u4", offset=4).reshape(-1, 4).tolist()
    return b"".join(LZOCompressor.decompress(packed[start : start + size], whole) for start, _, size, whole in rows)


class _Schema:
    """The fields that are written, each with a number from 1 on."""

    def __init__(self):
        self.fields: list[list] = []
        kinds = {"Series Compression": 11, "TimeBaseFrequency": REAL, "Series ID": WORD, "Trajectory Label": 21}
        self.numbers = {name: self.add(name, kind) for name, kind in (kinds | {"Trajectory Type": 13}).items()}
        cell = self.parts(
            [("X", INT), ("Y", INT), ("Diameter X", WORD16), ("Diameter Y", WORD16), ("Flags", FLAGS)],
            {"Flags": ("Marker was MMO corrected", "Touching boundaries", "Discarded by size test")},
        )
        row = self.add("Marker", PARTS, cell)
        frame = self.add("2d Frame", PARTS, self.parts([("Timestamp", LONG), ("Flags", FLAGS), ("Markers", ROW)]))
        self.fields[self.fields[frame - 1][2] + 1][2] = row
        names = [(name, REAL) for name in ("X", "Y", "Z", "Residual")] + [("Point Type", FLAGS), ("Padding", WORD)]
        parts = self.parts(names, {"Point Type": tuple(f"Point Type {name}" for name in POINT_TYPES)})
        point = self.add("3d Data Point", PARTS, parts)
        self.kinds = {"Measurement": 0, "2dData": 0, "2dCameraData": frame, "Trajectories": 0, "Trajectory": point}

    def add(self, name: str, kind: int, first: int = 0) -> int:
        self.fields.append([name, kind, first, 0])
        return len(self.fields)

    def parts(self, names, bits=None) -> int:
        """Parts one beside the other; the number of the first."""
        numbers = [self.add(name, kind) for name, kind in names]
        for one, other in pairwise(numbers):
            self.fields[one - 1][3] = other
        for name, own in (bits or {}).items():
            first = self.parts([(bit, BIT) for bit in own])
            self.fields[next(one for one in numbers if self.fields[one - 1][0] == name) - 1][2] = first
        return numbers[0]

    def metadata(self) -> bytes:
        content = struct.pack("<II", len(self.kinds), 196)
        for name, number in self.kinds.items():
            content += _text(name) + _text(name, 2) + struct.pack("<I", number)
        content += struct.pack("<II", len(self.fields), 276)
        for name, kind, first, following in self.fields:
            content += _text(name) + struct.pack("<IB", 1, 0) + _text(name, 2)
            content += struct.pack("<5I", kind, 0, 8, first, following)
        return content

    def root(self, recording: Recording, series: dict[int, bytes]) -> bytes:
        """The tree of items; `series` gets the data."""
        rate = [("TimeBaseFrequency", struct.pack("<d", recording.rate))]
        cameras = []
        if recording.blobs is not None:
            frames = recording.blobs.frames
            for index, name in enumerate(recording.cameras.names):
                number, here = 114 + index, name not in recording.video
                series[number] = _frames(recording.blobs, index) if here else b""
                ranges = [(int(frames[0]), int(frames[-1]))] if here else []
                cameras.append(self.item("2dCameraData", [("Series ID", struct.pack("<I", number))], ranges))
        points = []
        for index, one in enumerate(recording.trajectories):
            number = 200 + index
            series[number] = b"".join(struct.pack("<4dII", *record, 0xCDCDCDCD) for record in one.records)
            label = one.label.encode("utf-16-le")
            fields = [
                ("Series ID", struct.pack("<I", number)),
                ("Trajectory Label", struct.pack("<I", len(one.label)) + label + b"\0\0"),
                ("Trajectory Type", struct.pack("<I", 2 if one.discarded else 1)),
            ]
            points.append(self.item("Trajectory", fields, one.ranges))
        within = [self.item("2dData", rate, [], cameras), self.item("Trajectories", rate, [], points)]
        packing = [("Series Compression", struct.pack("<B", recording.packing))]
        return self.item("", packing, [], within)

    def item(self, kind: str, fields, ranges, within=()) -> bytes:
        names = list(self.kinds)
        content = struct.pack("<II", names.index(kind) + 1, 7) if kind else b""
        content += struct.pack("<I", len(fields))
        for name, value in fields:
            content += struct.pack("<II", self.numbers[name], len(value)) + value
        content += struct.pack("<I", len(ranges)) + b"".join(struct.pack("<II", *one) for one in ranges)
        content += struct.pack("<I", len(within)) + b"".join(within)
        order = struct.pack("<II", names.index(kind) + 2 if kind else 1, len(within)) if within else b""
        order += b"".join(struct.pack("<I", 1 + at) for at in range(len(within)))
        return content + struct.pack("<I", bool(within)) + order


def _text(text: str, width: int = 1) -> bytes:
    content = (text + "\0").encode("utf-8" if width == 1 else "utf-16-le")
    return struct.pack("<I", len(content)) + content


def _frames(blobs: Blobs, camera: int) -> bytes:
    """The frames of one camera; the diameters are those of a disc of the blob's area."""
    content = b""
    for frame in range(len(blobs.frames)):
        own = np.flatnonzero((blobs.frame == frame) & (blobs.camera == camera))
        content += struct.pack("<QII", 100_000 * frame, 0, len(own))
        for (x, y), area in zip(blobs.xy[own].tolist(), blobs.area[own].tolist(), strict=True):
            across = round(64 * np.sqrt(4 / np.pi * area)) if area == area else 0
            content += struct.pack("<iiHHI", round(64 * x), round(64 * y), across, across, 0)
    return content


def _camera(recording: Recording, index: int) -> bytes:
    """What is said of one camera; rows of the stored rotation: -z, x, -y of our own."""
    cameras, name = recording.cameras, recording.cameras.names[index]
    calibrated = name not in recording.uncalibrated
    right, down, ahead = cameras.rotation[index]
    stored, centre = np.stack([-ahead, right, -down]), cameras.centres[index] * 1000
    matrix, lens = 64 * cameras.matrix[index], cameras.distortion[index]
    numbers = [matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *lens[:4], recording.lens_rest]
    said = [(1 + at, struct.pack("<d", value)) for at, value in enumerate([*centre, *stored.ravel()])]
    said.append((13, struct.pack("<I9f", 0xC0000000, *numbers).ljust(560, b"\0")))
    said.append((14, struct.pack("<B", calibrated)))
    content = b"".join(struct.pack("<II", number, len(value)) + value for number, value in said)
    where = "C:\\calibration.qca".encode("utf-16-le")
    content += struct.pack("<II", 15, len(where) // 2) + where
    width, height = cameras.size[index]
    last = [(23, int(name)), (47, int(width) - 1), (48, int(height) - 1)]
    content += b"".join(struct.pack("<III", number, 4, value) for number, value in last)
    return struct.pack("<I", len(said) + 1 + len(last)) + content


def compound_file(parts: dict[str, bytes | None], sector: int = 512) -> bytes:
    """An OLE compound file with these streams and sectors of 512 (version 3) or 4096 bytes (version 4)."""
    tree: dict = {}
    for name, content in parts.items():
        if content is not None:
            *folders, own = name.split("/")
            at = tree
            for folder in folders:
                at = at.setdefault(folder, {})
            at[own] = content
    return _Compound(sector).whole(tree)


class _Compound:
    """Sectors, small sectors and entries of a compound file as they come together."""

    def __init__(self, sector: int):
        self.sector = sector
        self.body, self.chain = bytearray(), []
        self.small, self.small_chain = bytearray(), []
        self.entries: list[list] = [["Root Entry", 5, FREE, FREE, FREE, END, 0]]

    def whole(self, tree: dict) -> bytes:
        self.entries[0][4] = self.folder(tree)
        self.entries[0][5], self.entries[0][6] = self.put(bytes(self.small)), len(self.small)
        table = np.array(self.small_chain, "<u4").tobytes()
        small_start = self.put(table.ljust(-(-len(table) // self.sector) * self.sector, b"\xff"))
        directory = b"".join(map(_entry, self.entries))
        directory_start = self.put(directory.ljust(-(-len(directory) // self.sector) * self.sector, b"\0"))
        tables = 1
        while (len(self.chain) + tables) * 4 > tables * self.sector:
            tables += 1
        where = np.full(109, FREE, "<u4")
        where[:tables] = len(self.chain) + np.arange(tables)
        large = self.sector != 512
        sizes = 62, 3 + large, 0xFFFE, 9 + 3 * large, 6
        head = struct.pack("<8s16sHHHHH6x", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", b"", *sizes)
        head += struct.pack("<III", large * -(-len(directory) // self.sector), tables, directory_start)
        head += struct.pack("<IIIIII", 0, CUTOFF, small_start, -(-len(table) // self.sector), END, 0)
        chain = np.array(self.chain + [TABLE] * tables, "<u4").tobytes()
        head = (head + where.tobytes()).ljust(self.sector, b"\0")
        return head + bytes(self.body) + chain.ljust(tables * self.sector, b"\xff")

    def put(self, content: bytes) -> int:
        return _chained(content, self.sector, self.body, self.chain) if content else END

    def place(self, content: bytes) -> int:
        if len(content) >= CUTOFF or not content:
            return self.put(content)
        return _chained(content, SMALL, self.small, self.small_chain)

    def folder(self, children: dict) -> int:
        """Entries of a folder as a balanced tree; the number of its root."""
        return self.branch(children, sorted(children, key=lambda name: (len(name), name.upper())))

    def branch(self, children: dict, some: list[str]) -> int:
        if not some:
            return FREE
        middle, number = len(some) // 2, len(self.entries)
        own = children[some[middle]]
        entry = [some[middle], 1 if isinstance(own, dict) else 2, FREE, FREE, FREE, END, 0]
        self.entries.append(entry)
        if isinstance(own, dict):
            entry[4] = self.folder(own)
        else:
            entry[5], entry[6] = self.place(own), len(own)
        entry[2], entry[3] = self.branch(children, some[:middle]), self.branch(children, some[middle + 1 :])
        return number


def _chained(content: bytes, size: int, body: bytearray, chain: list[int]) -> int:
    start, count = len(chain), -(-len(content) // size)
    body += content.ljust(count * size, b"\0")
    chain += [*range(start + 1, start + count), END]
    return start


def _entry(entry: list) -> bytes:
    name, kind, left, right, child, start, size = entry
    letters = (name + "\0").encode("utf-16-le")
    where = left, right, child, b"", 0, 0, 0, start, size
    return struct.pack("<64sHBBIII16sIQQIQ", letters, len(letters), kind, 1, *where)
