"""What pymeshlab leaves out of a file, and MeshSet brings in."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pymeshlab
import pytest
import trimesh

from mesh_sets import positions
from oneform_warp.errors import OneFormWarning
from oneform_warp.filters import Chain, MeshSet, Step

TETRA = """ply
format ascii 1.0
comment painted elsewhere
element vertex 4
property double x
property double y
property double z
property float paint
property float turn_x
property float turn_y
property float turn_z
element face 4
property list uchar int vertex_indices
end_header
0 0 0 0 0 0 0
1 0 0 0.25 0 0 1
0 1 0 0.5 0 0 2
0 0 1 {last} 0 0 3
3 0 2 1
3 0 1 3
3 1 2 3
3 2 0 3
"""

GROUPED = """mtllib none.mtl
o body
g left
v 0 0 0
v 1 0 0
v 0 1 0
usemtl red
f 1 2 3
g right
v 1 1 0
usemtl blue
f -3//1 -1 \\
 -2
"""


def loaded(path: Path) -> MeshSet:
    meshes = MeshSet()
    meshes.load_new_mesh(path)
    return meshes


def test_unknown_ply_properties_become_attributes(tmp_path: Path) -> None:
    (tmp_path / "painted.ply").write_text(TETRA.format(last="1"))
    meshes = loaded(tmp_path / "painted.ply")
    assert np.array_equal(meshes.vertex_attribute("paint", columns=1), [0, 0.25, 0.5, 1])
    assert np.array_equal(meshes.vertex_attribute("turn", columns=3), [[0, 0, 0], [0, 0, 1], [0, 0, 2], [0, 0, 3]])
    meshes.set_oneform_handle(attribute="paint", angle=90.0, name="paint")
    assert np.array_equal(meshes.placed_handles().handles["paint"].weights, [0, 0.25, 0.5, 1])


def test_painted_weights_work_in_a_chain_and_stay_in_the_file(tmp_path: Path) -> None:
    (tmp_path / "painted.ply").write_text(TETRA.format(last="1"))
    chain = Chain(
        [
            Step("set_oneform_handle", {"condselect": "vi == 0", "held": True}),
            Step("set_oneform_handle", {"attribute": "paint", "angle": 40}),
            Step("apply_coord_oneform_deformation", {"weights": "uniform"}),
        ]
    )
    report = chain.process(tmp_path / "painted.ply", tmp_path / "out.ply")
    assert report.moved_only
    before, after = loaded(tmp_path / "painted.ply"), loaded(tmp_path / "out.ply")
    assert not np.array_equal(positions(before), positions(after))
    assert np.array_equal(after.vertex_attribute("paint", columns=1), before.vertex_attribute("paint", columns=1))
    assert "comment painted elsewhere" in (tmp_path / "out.ply").read_text()


def test_properties_of_vertices_that_were_not_loaded_are_left_out_with_a_warning(tmp_path: Path) -> None:
    (tmp_path / "nan.ply").write_text(TETRA.format(last="1").replace("0 0 1 1", "nan 0 1 1"))
    with pytest.warns(OneFormWarning, match="4 vertices are left out"):
        loaded(tmp_path / "nan.ply")


def test_glb_attributes_come_in(tmp_path: Path) -> None:
    mesh = trimesh.creation.box()
    mesh.vertex_attributes["_paint"] = np.linspace(0, 1, len(mesh.vertices)).astype(np.float32)
    mesh.export(tmp_path / "box.glb")
    paint = loaded(tmp_path / "box.glb").vertex_attribute("paint", columns=1)
    assert np.array_equal(paint, mesh.vertex_attributes["_paint"])


def test_scenes_stand_in_world_space(tmp_path: Path) -> None:
    scene = trimesh.Scene()
    scene.add_geometry(trimesh.creation.box(), transform=trimesh.transformations.translation_matrix([5, 0, 0]))
    scene.export(tmp_path / "scene.glb")
    meshes = loaded(tmp_path / "scene.glb")
    assert np.allclose(positions(meshes).mean(axis=0), [5, 0, 0])
    assert np.array_equal(meshes.current_mesh().transform_matrix(), np.eye(4))


def test_a_scene_that_cannot_be_deformed_is_named(tmp_path: Path) -> None:
    (tmp_path / "coded.gltf").write_text('{"asset": {"version": "2.0"}, "extensionsUsed": ["KHR_draco_mesh_compression"]}')  # fmt: skip
    with pytest.raises(pymeshlab.PyMeshLabException, match="Draco"):
        loaded(tmp_path / "coded.gltf")


@pytest.mark.parametrize(
    ("name", "vertices"),
    [("left", [0, 1, 2]), ("right", [1, 2, 3]), ("red", [0, 1, 2]), ("blue", [1, 2, 3]), ("body", [0, 1, 2, 3])],
)
def test_groups_objects_and_materials_are_selections(name: str, vertices: list[int], tmp_path: Path) -> None:
    (tmp_path / "parts.obj").write_text(GROUPED)
    meshes = loaded(tmp_path / "parts.obj")
    meshes.set_oneform_handle(group=name, held=True, name="part")
    assert np.flatnonzero(meshes.placed_handles().handles["part"].mask).tolist() == vertices


def test_an_unknown_group_names_the_nearest(tmp_path: Path) -> None:
    (tmp_path / "parts.obj").write_text(GROUPED)
    with pytest.raises(pymeshlab.PyMeshLabException, match="did you mean 'left'"):
        loaded(tmp_path / "parts.obj").set_oneform_handle(group="lefd", held=True)


def test_groups_are_gone_after_a_change_of_the_vertices(tmp_path: Path) -> None:
    (tmp_path / "parts.obj").write_text(GROUPED)
    meshes = loaded(tmp_path / "parts.obj")
    meshes.meshing_surface_subdivision_midpoint(iterations=1)
    assert meshes.named_parts() == {}


def test_records_across_lines_are_read(tmp_path: Path) -> None:
    (tmp_path / "broken.off").write_text("OFF 4 2 0\n0 0 0\n1 0 0\n0 1 0\n1 1 0\n3 0\n1 2 3\n2 1 3\n")
    meshes = loaded(tmp_path / "broken.off")
    assert meshes.current_mesh().face_matrix().tolist() == [[0, 1, 2], [2, 1, 3]]


def test_no_file_loses_a_vertex_without_a_word(meshes: Path) -> None:
    for path in sorted((meshes / "attributes").glob("*.ply")):
        meshes_read = loaded(path)
        header = path.read_bytes().split(b"end_header")[0].decode("latin-1")
        wanted = int(next(line.split()[2] for line in header.splitlines() if line.startswith("element vertex")))
        assert meshes_read.current_mesh().vertex_number() == wanted, path.name
