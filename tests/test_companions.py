"""Materials and textures go along with a mesh: those in its folder, and nothing else anywhere."""

import os

import pytest

from oneform_warp.errors import FileError
from oneform_warp.filters import read_mesh

MESH = "{}\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
PLY = (
    "ply\nformat ascii 1.0\ncomment TextureFile   my skin.png \nelement vertex 3\nproperty float x\nproperty float y\n"
    "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
)


@pytest.fixture
def folders(tmp_path):
    source, target = tmp_path / "in", tmp_path / "out"
    source.mkdir()
    target.mkdir()
    return source, target


def put(path, content):
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def write(source, library, target, **files):
    mesh = read_mesh(put(source / "a.obj", MESH.format(library)))
    return mesh.write(target / "a.obj", mesh.positions + 1)


def found(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


@pytest.mark.parametrize(
    ("library", "names"),
    [
        ("mtllib a.mtl", ["a.mtl"]),
        ("mtllib   my paints.mtl  ", ["my paints.mtl"]),
        ("mtllib a.mtl b.mtl", ["a.mtl", "b.mtl"]),
        ("mtllib missing.mtl a.mtl", ["a.mtl"]),
        ("mtllib a.mtl\r\nmtllib b.mtl\r", ["a.mtl", "b.mtl"]),
        ("mtllib grün.mtl", ["grün.mtl"]),
        ("mtllib sub/c.mtl", ["sub/c.mtl"]),
        ("mtllib sub\\c.mtl", ["sub/c.mtl"]),
        ("mtllib missing.mtl", []),
    ],
)
def test_libraries_are_found_however_they_are_spelled(folders, library, names):
    source, target = folders
    for name in ("a.mtl", "b.mtl", "my paints.mtl", "grün.mtl", "sub/c.mtl"):
        put(source / name, f"newmtl {name}\n")
    assert write(source, library, target) == ()
    assert found(target) == sorted(["a.obj", *names])


def test_textures_of_a_library_come_along(folders):
    source, target = folders
    lines = [
        "newmtl one",
        "map_Kd my skin.png",
        "bump -bm 0.5 tex/bumps.png",
        "  MAP_Ks  -o 1 1 1 -clamp on my gloss.png",
        "map_d none.png",
    ]
    put(source / "a.mtl", "\n".join(lines))
    for name in ("my skin.png", "tex/bumps.png", "my gloss.png", "unused.png"):
        put(source / name, os.urandom(50))
    assert write(source, "mtllib a.mtl", target) == ()
    assert found(target) == sorted(["a.mtl", "a.obj", "my gloss.png", "my skin.png", "tex/bumps.png"])
    for name in found(target)[1:]:
        if name != "a.obj":
            assert (target / name).read_bytes() == (source / name).read_bytes()


def test_textures_in_comments_of_a_ply_come_along_into_other_formats_too(folders):
    pytest.importorskip("pymeshlab", reason="pymeshlab is not installed")
    source, target = folders
    put(source / "my skin.png", b"not really a picture")
    mesh = read_mesh(put(source / "a.ply", PLY))
    assert mesh.write(target / "a.ply", mesh.positions + 1) == ()
    assert found(target) == ["a.ply", "my skin.png"]
    mesh.write(target / "a.off", mesh.positions + 1)
    assert found(target) == ["a.off", "a.ply", "my skin.png"]
    assert (source / "my skin.png").read_bytes() == b"not really a picture"


@pytest.mark.parametrize(
    "name", ["../secret.mtl", "{root}/secret.mtl", "sub/../../secret.mtl", "..\\secret.mtl", "link.mtl"]
)
def test_nothing_outside_the_folder_is_copied(folders, name):
    source, target = folders
    put(source / "sub" / "x", "")
    secret = put(source.parent / "secret.mtl", "newmtl secret")
    (source / "link.mtl").symlink_to(secret)
    warnings = write(source, f"mtllib {name.format(root=source.parent)}", target)
    assert len(warnings) == 1
    assert "is not in the folder of the mesh" in warnings[0]
    assert found(target) == ["a.obj"]
    assert found(source.parent) == sorted(["secret.mtl", "in/a.obj", "in/link.mtl", "in/sub/x", "out/a.obj"])


@pytest.mark.parametrize("name", ["/etc/hostname", "../secret.png", "C:\\secret.png"])
def test_textures_outside_the_folder_are_not_copied(folders, name):
    source, target = folders
    put(source.parent / "secret.png", "secret")
    put(source / "a.mtl", f"newmtl a\nmap_Kd {name}\n")
    warnings = write(source, "mtllib a.mtl", target)
    assert [name in warning.replace("\\\\", "\\") for warning in warnings] == [True]
    assert found(target) == ["a.mtl", "a.obj"]


def test_nothing_is_written_through_a_link_out_of_the_folder(folders):
    source, target = folders
    put(source / "sub" / "c.mtl", "newmtl c")
    elsewhere = source.parent / "elsewhere"
    elsewhere.mkdir()
    (target / "sub").symlink_to(elsewhere)
    warnings = write(source, "mtllib sub/c.mtl", target)
    assert "would be written outside" in warnings[0]
    assert found(elsewhere) == []


def test_a_file_that_is_there_already_stays(folders):
    source, target = folders
    put(source / "a.mtl", "newmtl mine")
    other = put(target / "a.mtl", "newmtl another's")
    assert "with other contents" in write(source, "mtllib a.mtl", target)[0]
    assert other.read_text() == "newmtl another's"
    put(other, "newmtl mine")
    assert write(source, "mtllib a.mtl", target) == ()


def test_in_the_folder_of_the_mesh_nothing_is_copied(folders):
    source, _ = folders
    put(source / "a.mtl", "newmtl a\nmap_Kd ../x.png\n")
    mesh = read_mesh(put(source / "a.obj", MESH.format("mtllib a.mtl")))
    assert mesh.write(source / "b.obj", mesh.positions + 1) == ()
    assert found(source) == ["a.mtl", "a.obj", "b.obj"]


@pytest.mark.parametrize("name", ["x" * 300 + ".mtl", "a\0b.mtl", ""])
def test_names_that_no_file_can_have_do_no_harm(folders, name):
    source, target = folders
    write(source, f"mtllib {name}", target)
    assert found(target) == ["a.obj"]


@pytest.mark.parametrize("name", [".", "sub", "..", "/"])
def test_a_library_that_is_a_folder_is_named(folders, name):
    """MeshLab would never come back from it."""
    source, target = folders
    (source / "sub").mkdir()
    with pytest.raises(FileError, match="is a folder"):
        write(source, f"mtllib {name}", target)
