"""OBJ lines: vertices and normals change, shared normals part where they turn differently."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oneform_warp.filters.formats import ObjRecords
from oneform_warp.filters.formats.motion import Motion, turned_by

PLANE = b"""# a flat strip, one normal for all
mtllib  strip.mtl
v 0 0 0 1 0 0
v 1 0 0\t0 1 0
v 1 1 0
 v 0 1 0
v 2 0 0
v 2 1 0
vt 0 0
vn 0 0 1 # up
vn 1 0 0
s 1
g left
usemtl red
f 1/1/1 2/1/1 3/1/1 4/1/1
g right
f -5/1/1 -2//-2 -1//-2 \\
  -4//1
l 1 2
"""


def lines(data, kind):
    return [line.split() for line in data.decode().splitlines() if line.split()[:1] == [kind]]


def motion(records, after=None, omega=None, normals="rotate"):
    before = records.positions()
    return Motion(before, before if after is None else after, records.polygons(), omega, normals)


def corner_values(data):
    """The normal of each corner, by a plain reading of the text."""
    normals = [list(map(float, words[1:4])) for words in lines(data, "vn")]
    text = data.decode().replace("\\\n", " ").splitlines()
    corners = [word.split("/") for line in text if line.split()[:1] == ["f"] for word in line.split()[1:]]
    return [normals[int(c[2]) - 1 if int(c[2]) > 0 else int(c[2])] for c in corners]


def test_all_spellings_of_faces_are_read():
    records = ObjRecords.read(PLANE)
    assert (records.vertices, records.faces) == (6, 2)
    indices, offsets = records.polygons()
    assert indices.tolist() == [0, 1, 2, 3, 1, 4, 5, 2]
    assert offsets.tolist() == [0, 4, 8]
    assert {name: part.tolist() for name, part in records.groups().items()} == {
        "left": [0, 1, 2, 3],
        "right": [1, 2, 4, 5],
    }
    assert records.companions() == ("strip.mtl",)


def test_nothing_moves_and_every_byte_stays():
    records = ObjRecords.read(PLANE)
    assert records.moved(motion(records)) == PLANE
    assert records.moved(motion(records, omega=np.zeros((6, 3)))) == PLANE


def test_only_the_lines_of_what_moves_change():
    records = ObjRecords.read(PLANE)
    after = records.positions()
    after[1] = [1.5, 0.1, -2e-30]
    expected = PLANE.replace(b"v 1 0 0\t0 1 0", b"v 1.5 0.1 -2e-30\t0 1 0")
    assert records.moved(motion(records, after, normals="keep")) == expected


def test_a_normal_that_all_turn_alike_stays_one():
    records = ObjRecords.read(PLANE)
    out = records.moved(motion(records, omega=np.tile([np.pi / 2, 0, 0], (6, 1))))
    assert out == PLANE.replace(b"vn 0 0 1", b"vn 0.0 -1.0 0.0")


def test_a_shared_normal_parts_where_vertices_turn_differently():
    records = ObjRecords.read(PLANE)
    omega = np.zeros((6, 3))
    omega[4:] = [0, np.pi / 2, 0]
    out = records.moved(motion(records, omega=omega))
    assert len(lines(out, "vn")) == 3
    expected = [[0, 0, 1]] * 5 + [[1, 0, 0]] * 2 + [[0, 0, 1]]
    assert corner_values(out) == expected
    untouched = ("v", "vt", "mtllib", "s", "g", "usemtl", "l", "#")
    assert [lines(out, kind) for kind in untouched] == [lines(PLANE, kind) for kind in untouched]
    again = ObjRecords.read(out)
    assert again.polygons()[0].tolist() == records.polygons()[0].tolist()


@given(
    st.lists(st.tuples(*[st.integers(0, 3)] * 4), min_size=1, max_size=6),
    st.lists(st.sampled_from([0.0, 0.5, -2.0]), min_size=4, max_size=4),
    st.booleans(),
)
def test_each_corner_gets_its_own_normal_turned(corners, angles, negative):
    """corners: the normal of each of the four vertices, a face for each tuple."""
    normals = np.float64([[0, 0, 1], [1, 0, 0], [0, 1, 0], [0, 0, -1]])
    text = [f"v {x} {y} {x * y}" for x in (0, 1) for y in (0, 1)]
    text += ["vn " + " ".join(f"{value:g}" for value in normal) for normal in normals]
    for face in corners:
        text.append("f " + " ".join(f"{v + 1}//{n - 4 if negative else n + 1}" for v, n in enumerate(face)))
    data = ("\n".join(text) + "\n").encode()
    records = ObjRecords.read(data)
    omega = np.array([[angle, 0, angle] for angle in angles])
    out = records.moved(motion(records, omega=omega))
    expected = [turned_by(omega[[v]], normals[[n]])[0] for face in corners for v, n in enumerate(face)]
    np.testing.assert_allclose(corner_values(out), expected, atol=1e-6)
    if not any(angles):
        assert out == data


def test_recomputed_normals_are_those_of_the_surface():
    records = ObjRecords.read(PLANE)
    after = records.positions()[:, [2, 0, 1]]  # the plane's normal becomes x
    out = records.moved(motion(records, after, normals="recompute"))
    assert corner_values(out) == [[1, 0, 0]] * 8


def test_normals_beside_the_vertices_of_a_cloud_turn_too():
    data = b"vn 0 0 1\nv 1 2 3\nvn 0 1 0\nv 4 5 6\n"
    records = ObjRecords.read(data)
    omega = np.array([[0, 0, 0], [0, 0, np.pi / 2]])
    assert records.moved(motion(records, omega=omega)) == data.replace(b"vn 0 1 0", b"vn -1.0 0.0 0.0")


def test_a_normal_that_is_not_there_is_named():
    records = ObjRecords.read(PLANE.replace(b"4/1/1", b"4/1/9"))
    with pytest.raises(ValueError, match="a face uses normal 9 of 2"):
        records.moved(motion(records, omega=np.ones((6, 3))))
