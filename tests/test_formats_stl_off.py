"""STL soups and OFF files with normals, colours and comments."""

import os
import struct

import numpy as np
import pytest

from oneform_warp.filters import read_mesh
from oneform_warp.filters.formats import OffRecords, StlRecords
from oneform_warp.filters.formats.motion import Motion

CORNERS = np.float32([[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[1, 0, 0], [1, 1, 0], [0, 1, 0]]])


def binary_stl(title=b"solid, in spite of its name"):
    data = title.ljust(80) + struct.pack("<I", 2)
    for number, corners in enumerate(CORNERS):
        data += np.float32([0, 0, 1]).tobytes() + corners.tobytes() + struct.pack("<H", 7 + number)
    return data


def text_stl(solids=1):
    lines = []
    for number in range(solids):
        lines.append(f"solid Part {number}")
        for corners in CORNERS + np.float32(2 * number):
            lines += ["  facet normal 0 0 1", "    outer loop"]
            lines += [f"      vertex {x:e} {y:e} {z:e}" for x, y, z in corners]
            lines += ["    endloop", "  endfacet"]
        lines.append(f"endsolid Part {number}")
    return "\n".join(lines).encode()


@pytest.fixture(params=["pymeshlab", "trimesh"])
def backend(request):
    pytest.importorskip(request.param, reason=f"{request.param} is not installed")
    return request.param


@pytest.mark.parametrize("content", [binary_stl(), text_stl(), text_stl(3)], ids=["binary", "text", "three solids"])
def test_a_soup_moves_as_one_surface(tmp_path, content, backend):
    if content.startswith(b"solid Part 0") and b"Part 2" in content and backend == "trimesh":
        pytest.skip("trimesh makes several meshes of several solids")
    (tmp_path / "a.stl").write_bytes(content)
    mesh = read_mesh(tmp_path / "a.stl", backend=backend)
    records = StlRecords.read(content)
    np.testing.assert_array_equal(mesh.positions[mesh.vertex_of], records.positions())
    mesh.write(tmp_path / "b.stl", mesh.positions)
    assert (tmp_path / "b.stl").read_bytes() == content
    mesh.write(tmp_path / "b.stl", mesh.positions[:, [2, 0, 1]] * 2)  # x -> y -> z -> x
    again = StlRecords.read((tmp_path / "b.stl").read_bytes())
    np.testing.assert_array_equal(again.positions(), records.positions()[:, [2, 0, 1]] * 2)
    normals = again.table["normal"] if again.binary else again.words.floats(again._numbers()[0])
    np.testing.assert_allclose(normals, [[1, 0, 0]] * records.faces, atol=1e-6)
    if records.binary:
        assert again.data[:80] == content[:80]
        assert again.table["attribute"].tolist() == [7, 8]
    else:
        words = ("solid", "facet", "outer", "endloop", "endfacet", "endsolid")
        kept = [line for line in content.decode().splitlines() if line.split()[0] in words[2:] + words[:1]]
        assert [line for line in again.data.decode().splitlines() if line.split()[0] in words[2:] + words[:1]] == kept


def test_triangles_that_stay_keep_their_normals_bit_for_bit(tmp_path):
    odd = binary_stl().replace(np.float32([0, 0, 1]).tobytes(), np.float32([0.1, 0, 0.7]).tobytes(), 1)
    (tmp_path / "a.stl").write_bytes(odd)
    mesh = read_mesh(tmp_path / "a.stl")
    moved = mesh.positions.copy()
    moved[(moved == [1, 1, 0]).all(axis=1)] = [1, 1, 1]
    mesh.write(tmp_path / "b.stl", moved)
    table = StlRecords.read((tmp_path / "b.stl").read_bytes()).table
    np.testing.assert_array_equal(table["normal"][0], np.float32([0.1, 0, 0.7]))
    np.testing.assert_allclose(table["normal"][1], np.float32([-1, -1, 1]) / np.sqrt(3), atol=1e-6)


NOFF = b"""# before
NCOFF # kind
4 2 0

0 0 0  0 0 1  255 0 0 255 # first
1 0 0\t0 0 1  0 255 0 255
# between
1 1 0  0 0 1  0 0 255 255
0 1 0  0 0 1  9 9 9 9
3 0 1 2  0.1 0.2 0.3
3 0 2 3  1 0 0 # last
"""


def test_off_changes_coordinates_and_normals_only():
    records = OffRecords.read(NOFF)
    before = records.positions()
    omega = np.zeros((4, 3))
    omega[1] = [0, np.pi / 2, 0]
    after = before.copy()
    after[1] = [1, 0.5, -1]
    out = records.moved(Motion(before, after, records.polygons(), omega))
    assert out == NOFF.replace(b"1 0 0\t0 0 1  0 255", b"1.0 0.5 -1.0\t1.0 0.0 0.0  0 255")
    assert records.moved(Motion(before, before, records.polygons())) == NOFF


def test_off_vertices_may_share_lines():
    data = b"OFF\n4 2 0\n0 0 0 1 0 0\n1 1 0 0 1\n0\n3 0 1 2\n3 0 2 3\n"
    records = OffRecords.read(data)
    before = records.positions()
    assert before.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    assert records.polygons()[0].tolist() == [0, 1, 2, 0, 2, 3]
    after = before + np.float64([[0, 0, 0], [0, 0, 0], [0, 0, 5], [0, 0, 0]])
    assert records.moved(Motion(before, after, records.polygons())) == data.replace(b"1 1 0 0 1", b"1.0 1.0 5.0 0 1")


@pytest.mark.parametrize("header", [b"OFF BINARY\n", b"4OFF\n", b"nOFF\n4\n", b"PLY\n"])
def test_other_kinds_of_off_are_not_guessed(header):
    with pytest.raises(ValueError, match="not an OFF header"):
        OffRecords.read(header + b"1 0 0\n0 0 0\n")


def test_comments_at_the_ends_of_lines_can_be_read(tmp_path):
    pytest.importorskip("pymeshlab", reason="pymeshlab is not installed")
    data = b"OFF\n# head\n3 1 0\n0 0 0\n1 0 0 # odd\n0 1 0\n3 0 1 2 1.0 0.5 0.5\n"
    (tmp_path / "a.off").write_bytes(data)
    folder = os.getcwd()
    mesh = read_mesh(tmp_path / "a.off")
    assert os.getcwd() == folder
    mesh.write(tmp_path / "b.off", mesh.positions * 2)
    assert (tmp_path / "b.off").read_bytes() == data.replace(b"1 0 0 #", b"2.0 0.0 0.0 #").replace(
        b"\n0 1 0\n", b"\n0.0 2.0 0.0\n"
    )
