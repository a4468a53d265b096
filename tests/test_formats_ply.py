"""PLY files of all layouts: only the numbers that move change."""

import struct
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oneform_warp.errors import FileError
from oneform_warp.filters import read_mesh
from oneform_warp.filters.formats import PlyRecords
from oneform_warp.filters.formats.motion import Motion

CODES = {"char": "b", "uchar": "B", "short": "h", "ushort": "H", "int": "i", "uint": "I", "float": "f", "double": "d",
         "int8": "b", "uint8": "B", "int32": "i", "float32": "f", "float64": "d"}  # fmt: skip
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


def spell(kind, value):
    if CODES[kind] == "f":
        return str(np.float32(value))
    return repr(float(value)) if CODES[kind] == "d" else str(int(value))


def make_ply(encoding, elements):
    """A file from {element: ([(property, type, count type or None)], rows)}."""
    header, body = ["ply", f"format {encoding} 1.0", "comment made  by hand"], b""
    for element, (properties, rows) in elements.items():
        header.append(f"element {element} {len(rows)}")
        header += [f"property {f'list {count} ' if count else ''}{kind} {name}" for name, kind, count in properties]
        for row in rows:
            flat = []
            for (_, kind, count), value in zip(properties, row, strict=True):
                flat += [(count, len(value)), *((kind, each) for each in value)] if count else [(kind, value)]
            if encoding == "ascii":
                body += " ".join(spell(kind, value) for kind, value in flat).encode() + b"\n"
            else:
                body += b"".join(struct.pack(ORDERS[encoding] + CODES[kind], value) for kind, value in flat)
    return "\n".join([*header, "end_header\n"]).encode() + body


def quarter():
    return st.integers(-4000, 4000).map(lambda n: n / 4)


@st.composite
def files(draw):
    """PLY contents: vertices among other elements, lists of equal and unequal length in any place."""
    encoding = draw(st.sampled_from(sorted(ORDERS)))
    kind = draw(st.sampled_from(["float", "double", "float32", "float64"]))
    count = draw(st.integers(1, 5))
    extra = draw(st.lists(st.sampled_from(["heat", "tags", "label"]), unique=True))
    specs = {"heat": ("heat", "double", None), "tags": ("tags", "short", "uchar"), "label": ("label", "int8", None)}
    values = {
        "heat": quarter(),
        "tags": st.lists(st.integers(-300, 300), max_size=3),
        "label": st.integers(-128, 127),
    }
    coordinates = [(axis, kind, None) for axis in draw(st.permutations("xyz"))]
    place = draw(st.integers(0, len(extra)))
    properties = [specs[name] for name in extra[:place]] + coordinates + [specs[name] for name in extra[place:]]
    rows = [
        [draw(values[name]) if name in values else draw(quarter()) for name, _, _ in properties] for _ in range(count)
    ]
    corner = st.lists(st.integers(0, count - 1), min_size=3, max_size=5)
    faces = draw(st.lists(corner, max_size=4))
    elements = {
        "vertex": (properties, rows),
        "face": ([("quality", "float", None), ("vertex_indices", "int", "uchar")], [(0.5, each) for each in faces]),
        "camera": ([("gain", "float", None)], [(2.5,), (1.0,)]),
    }
    order = draw(st.permutations(sorted(elements)))
    return encoding, {name: elements[name] for name in order}


def columns(properties, rows):
    return np.array([[row[[p[0] for p in properties].index(axis)] for axis in "xyz"] for row in rows], dtype=float)


@given(files(), st.data())
def test_any_layout_is_read_and_changed_in_place(file, data):
    encoding, elements = file
    content = make_ply(encoding, elements)
    records = PlyRecords.read(content)
    properties, rows = elements["vertex"]
    before = columns(properties, rows)
    np.testing.assert_array_equal(records.positions(), before)
    indices, offsets = records.polygons()
    assert [indices[a:b].tolist() for a, b in pairwise(offsets)] == [face[1] for face in elements["face"][1]]
    assert records.moved(Motion(before, before, (indices, offsets))) == content
    row = data.draw(st.integers(0, len(rows) - 1))
    after = before.copy()
    after[row] += 0.25
    names = [p[0] for p in properties]
    changed = [list(each) for each in rows]
    for axis in range(3):
        changed[row][names.index("xyz"[axis])] = after[row, axis]
    expected = make_ply(encoding, {**elements, "vertex": (properties, changed)})
    assert records.moved(Motion(before, after, (indices, offsets))) == expected


def with_normals(encoding):
    properties = [(name, "float", None) for name in ("x", "y", "z", "nx", "ny", "nz")]
    points = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (5, 5, 5)]
    rows = [(*point, 0.6, 0.0, 0.8) for point in points]
    return make_ply(
        encoding,
        {"vertex": (properties, rows), "face": ([("vertex_indices", "int", "uchar")], [([0, 1, 2],)])},
    )


def normals_of(path):
    records = PlyRecords.read(path.read_bytes())
    return np.stack([records.scalars()[name] for name in ("nx", "ny", "nz")], axis=1)


@pytest.mark.parametrize("encoding", sorted(ORDERS))
@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"omega": np.float64([[0, 0, 0], [0, 0, np.pi / 2], [0, 0, 2 * np.pi], [np.pi, 0, 0]])},
         [[0.6, 0, 0.8], [0, 0.6, 0.8], [0.6, 0, 0.8], [0.6, 0, -0.8]]),
        ({"normals": "recompute"}, [[1, 0, 0]] * 3 + [[0.6, 0, 0.8]]),
        ({"normals": "keep"}, [[0.6, 0, 0.8]] * 4),
        ({}, [[0.8, 0, -0.6]] * 3 + [[0.6, 0, 0.8]]),  # by the least rotation from z to x
    ],
)  # fmt: skip
def test_normals_turn_as_asked(tmp_path, encoding, options, expected):
    (tmp_path / "a.ply").write_bytes(with_normals(encoding))
    mesh = read_mesh(tmp_path / "a.ply")
    moved = mesh.positions.copy()
    moved[:3] = mesh.positions[:3][:, [2, 0, 1]]  # x -> y -> z -> x: the triangle's normal becomes x
    mesh.write(tmp_path / "b.ply", moved, **options)
    np.testing.assert_allclose(normals_of(tmp_path / "b.ply"), expected, atol=2e-6)


def test_a_coordinate_that_the_type_cannot_hold_is_named(tmp_path):
    (tmp_path / "a.ply").write_bytes(with_normals("binary_little_endian"))
    mesh = read_mesh(tmp_path / "a.ply")
    with pytest.raises(FileError, match="too large for x, which has 32 bits"):
        mesh.write(tmp_path / "b.ply", mesh.positions + 1e39)
    assert not (tmp_path / "b.ply").exists()


def test_windows_line_ends_and_comments_stay(tmp_path):
    content = with_normals("ascii").replace(b"\n", b"\r\n")
    (tmp_path / "a.ply").write_bytes(content)
    mesh = read_mesh(tmp_path / "a.ply")
    moved = mesh.positions.copy()
    moved[3] = [7, 8, 9]
    mesh.write(tmp_path / "b.ply", moved, normals="keep")
    assert (tmp_path / "b.ply").read_bytes() == content.replace(b"5.0 5.0 5.0 ", b"7.0 8.0 9.0 ")


@pytest.mark.parametrize("cut", [-1, -20, -60])
@pytest.mark.parametrize("encoding", ["binary_little_endian", "binary_big_endian"])
def test_a_file_that_ends_too_early_raises(encoding, cut):
    records = PlyRecords.read(with_normals(encoding)[:cut])
    with pytest.raises(ValueError, match="ends too early"):
        records.polygons()
