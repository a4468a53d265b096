"""Chains: checked whole before anything runs, and the same bits by every way of running them."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pymeshlab
import pytest
import trimesh

from mesh_sets import bar, positions
from oneform_warp.errors import FileError, InputError, OneFormWarning
from oneform_warp.filters import Chain, MeshSet, Step
from oneform_warp.filters.handle_set import StaleHandles
from oneform_warp.filters.native import ABORTING, native_filters, native_plain

SMOOTH = Step("apply_coord_laplacian_smoothing", {"stepsmoothnum": 1})
TWIST = [
    Step("set_oneform_handle", {"condselect": "z < 0.1", "held": True}),
    Step("set_oneform_handle", {"condselect": "z > 0.9", "angle": 90}),
    Step("apply_coord_oneform_deformation"),
]
SELECTED = [
    Step("compute_selection_by_condition_per_vertex", {"condselect": "z < zmin + 0.1*(zmax-zmin)"}),
    Step("set_oneform_handle", {"held": True}),
    Step("compute_selection_by_condition_per_vertex", {"condselect": "z > zmin + 0.9*(zmax-zmin)"}),
    Step("set_oneform_handle", {"angle": 90, "rotaxis": "Z axis"}),
    Step("apply_coord_oneform_deformation", {"smoothing": "length", "length": "40%"}),
]
MIXED = [Step("apply_coord_taubin_smoothing", {"stepsmoothnum": 2, "lambda_": 0.3}), *SELECTED, SMOOTH]


@pytest.fixture
def scan(tmp_path: Path) -> Path:
    bar().save_current_mesh(str(tmp_path / "scan.ply"))
    return tmp_path / "scan.ply"


def loaded(path: Path) -> MeshSet:
    meshes = MeshSet()
    meshes.load_new_mesh(path)
    return meshes


def arrays_of(meshes: MeshSet) -> tuple[np.ndarray, np.ndarray]:
    """Positions and faces; a pymeshlab.Mesh does not outlive its MeshSet."""
    return positions(meshes), np.array(meshes.current_mesh().face_matrix())


# ------------------------------------------------------------------ one result, whatever the way


def test_native_own_native_gives_the_same_bits_by_every_way(scan: Path, tmp_path: Path) -> None:
    by_name = loaded(scan)
    for step in MIXED:
        by_name.apply_step(step)
    wanted = positions(by_name)
    assert not np.allclose(wanted, positions(loaded(scan)))

    by_method = loaded(scan)
    for step in MIXED:
        getattr(by_method, step.filter)(**step.parameters)
    assert np.array_equal(positions(by_method), wanted)

    by_name.save_filter_script(tmp_path / "script.mlx")
    by_script = loaded(scan)
    by_script.load_filter_script(tmp_path / "script.mlx")
    by_script.apply_filter_script()
    assert np.array_equal(positions(by_script), wanted)

    by_chain = loaded(scan)
    report = Chain(MIXED).run(by_chain)
    assert np.array_equal(positions(by_chain), wanted)
    assert (report.converged, report.moved_only, report.warnings) == (True, True, ())

    Chain.from_script(tmp_path / "script.mlx").process(scan, tmp_path / "replayed.ply")
    Chain(MIXED).process(scan, tmp_path / "posed.ply")
    assert np.array_equal(positions(loaded(tmp_path / "posed.ply")), wanted)
    assert (tmp_path / "replayed.ply").read_bytes() == (tmp_path / "posed.ply").read_bytes()

    x, faces = arrays_of(loaded(scan))
    assert np.array_equal(Chain(MIXED).apply((x, faces))[0], wanted)
    assert np.array_equal(Chain(MIXED).apply(trimesh.Trimesh(x, faces, process=False)).vertices, wanted)


def test_another_process_gives_the_same_bytes(scan: Path, tmp_path: Path) -> None:
    Chain(TWIST).process(scan, tmp_path / "here.ply")
    code = (
        "import sys; from oneform_warp.filters import Chain, Step\n"
        f"Chain([{', '.join(f'Step({s.filter!r}, {dict(s.parameters)!r})' for s in TWIST)}])"
        ".process(sys.argv[1], sys.argv[2])"
    )
    subprocess.run([sys.executable, "-c", code, str(scan), str(tmp_path / "there.ply")], check=True, timeout=300)
    assert (tmp_path / "here.ply").read_bytes() == (tmp_path / "there.ply").read_bytes()


# ------------------------------------------------------------------ errors before anything runs


@pytest.mark.parametrize(
    ("step", "words"),
    [
        (Step("apply_coord_oneform_deformatoin"), ["no such filter", "did you mean 'apply_coord_oneform_deformation'"]),
        (Step("set_oneform_handle", {"angel": 3}), ["no parameter 'angel'", "did you mean 'angle'"]),
        (Step("set_oneform_handle", {"stretch": -1}), ["stretch is -1", "> 0"]),
        (Step("apply_coord_laplacian_smoothing", {"stepsmooth": 3}), ["no parameter 'stepsmooth'", "'stepsmoothnum'"]),
        (Step("apply_coord_laplacian_smoothing", {"stepsmoothnum": "x"}), ["stepsmoothnum is 'x'", "int"]),
        (Step("compute_matrix_from_rotation", {"angle": 1000}), ["angle is 1000, out of range", "360"]),
        (Step("compute_matrix_from_rotation", {"rotaxis": "Q"}), ["'X axis'; 'Y axis'"]),
        (Step("meshing_isotropic_explicit_remeshing", {"targetlen": "many"}), ["targetlen is 'many'", '"5%"']),
        (Step("meshing_isotropic_explicit_remeshing", {"targetlen": "500%"}), ["500%", "at most 100%"]),
        (Step("compute_matrix_from_rotation", {"customaxis": [1, 2]}), ["customaxis is (1, 2)", "3 finite numbers"]),
        (Step("set_camera_per_mesh", {"shot": "x"}), ["takes no camera"]),
    ],
)  # fmt: skip
def test_a_step_that_cannot_work_is_named_before_anything_runs(step: Step, words: list[str]) -> None:
    with pytest.raises(InputError) as caught:
        Chain([SMOOTH, step])
    for word in (f"step 2, {step.filter}", *words):
        assert word in str(caught.value)


@pytest.mark.parametrize("name", sorted(ABORTING))
def test_filters_that_abort_without_opengl_are_refused_by_name(name: str) -> None:
    with pytest.raises(InputError, match="OpenGL"):
        Chain([Step(name)])


def test_they_are_15_and_pymeshlab_has_them_all() -> None:
    assert len(ABORTING) == 15
    assert native_filters() >= ABORTING


def test_every_native_filter_takes_its_own_defaults() -> None:
    meshes = bar()
    meshes.compute_scalar_by_function_per_face(q="0")
    for name in sorted(native_filters() - {"set_camera_per_mesh", "set_camera_per_raster"} - ABORTING):
        assert native_plain(name, {}) == {}, name


@pytest.mark.parametrize(
    ("steps", "kind", "words"),
    [
        ([SELECTED[1]], InputError, ["step 1, set_oneform_handle", "nothing is selected", "condselect"]),
        ([SMOOTH, TWIST[2]], InputError, ["step 2, apply_coord_oneform_deformation", "no handle"]),
        ([*TWIST[:2], Step("clear_oneform_handles"), TWIST[2]], InputError, ["step 4", "no handle"]),
        ([*TWIST[:2], Step("meshing_decimation_quadric_edge_collapse"), TWIST[2]], StaleHandles,
         ["step 4", "step 3, meshing_decimation_quadric_edge_collapse", "set the handles after it"]),
    ],
)  # fmt: skip
def test_steps_in_an_impossible_order_are_named_before_a_file_is_read(
    steps: list[Step], kind: type[InputError], words: list[str], tmp_path: Path
) -> None:
    with pytest.raises(kind) as caught:
        Chain(steps).process(tmp_path / "there is no such file.ply", tmp_path / "out.ply")
    for word in words:
        assert word in str(caught.value)


def test_a_step_that_fails_on_a_mesh_is_named(scan: Path, tmp_path: Path) -> None:
    far = Step("set_oneform_handle", {"condselect": "z > 99", "angle": 1})
    with pytest.raises(InputError, match=r"step 1, set_oneform_handle: condition: no vertex is selected"):
        Chain([far]).process(scan, tmp_path / "out.ply")
    bad = Step("compute_selection_by_condition_per_vertex", {"condselect": "nonsense >"})
    with pytest.raises(InputError, match=r"step 2, compute_selection_by_condition_per_vertex"):
        Chain([SMOOTH, bad]).process(scan, tmp_path / "out.ply")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["scan.ply"]


def test_stale_handles_are_named_on_a_mesh(scan: Path) -> None:
    steps = [*TWIST[:2], Step("meshing_remove_vertices_by_scalar", {"maxqualitythr": 1.0}), TWIST[2]]
    with pytest.raises(StaleHandles, match="step 4"):
        Chain(steps).run(loaded(scan))


# ------------------------------------------------------------------ parameters as plain data


def test_parameters_become_plain_data() -> None:
    length = pymeshlab.PercentageValue(2.5)
    steps = [
        Step("meshing_isotropic_explicit_remeshing", {"targetlen": length, "maxsurfdist": pymeshlab.PureValue(0.5)}),
        Step("compute_matrix_from_rotation", {"customaxis": np.array([0.0, 0.0, 1.0])}),
        Step("set_color_per_vertex", {"color1": pymeshlab.Color(1, 2, 3)}),
        Step("apply_coord_oneform_deformation", {"length": length, "maxiterations": np.int64(7)}),
    ]
    plain = [dict(step.parameters) for step in Chain(steps).steps]
    assert plain == [
        {"targetlen": "2.5%", "maxsurfdist": 0.5},
        {"customaxis": (0.0, 0.0, 1.0)},
        {"color1": (1, 2, 3, 255)},
        {"length": "2.5%", "maxiterations": 7},
    ]
    assert Chain(Chain(steps).steps) == Chain(steps)


@pytest.mark.parametrize("length", ["10%", 0.1])
def test_native_lengths_are_percentages_or_plain_numbers(length: object) -> None:
    meshes, wanted = bar(), bar()
    Chain([Step("meshing_isotropic_explicit_remeshing", {"targetlen": length, "iterations": 1})]).run(meshes)
    given = pymeshlab.PercentageValue(10) if length == "10%" else pymeshlab.PureValue(0.1)
    wanted.meshing_isotropic_explicit_remeshing(targetlen=given, iterations=1)
    assert np.array_equal(positions(meshes), positions(wanted))


# ------------------------------------------------------------------ reports


def test_the_report_has_the_deformation_and_the_time_of_each_step(scan: Path, tmp_path: Path) -> None:
    report = Chain([SMOOTH, *TWIST]).process(scan, tmp_path / "out.ply")
    steps = ["1 apply_coord_laplacian_smoothing", "2 set_oneform_handle", "3 set_oneform_handle", "4 apply_coord_oneform_deformation"]  # fmt: skip
    assert list(report.seconds) == ["load", *steps, "save"]
    assert report.energy is not None
    assert report.energy > 0
    assert report.residual is not None
    assert report.residual <= 1.0
    assert report.iterations
    native_only = Chain([SMOOTH]).process(scan, tmp_path / "out.ply")
    assert (native_only.energy, native_only.residual, native_only.iterations) == (None, None, None)


def test_warnings_and_failure_to_converge_are_in_the_report(scan: Path, tmp_path: Path) -> None:
    steps = [TWIST[0], Step("set_oneform_handle", {"condselect": "z > 0.9", "angle": 4000})]
    report = Chain([*steps, TWIST[2]]).process(scan, tmp_path / "out.ply")
    assert any("45 degrees" in text for text in report.warnings)
    few = Step("apply_coord_oneform_deformation", {"maxiterations": 1, "solver": "jacobi", "weights": "uniform"})
    report = Chain([*TWIST[:2], few]).process(scan, tmp_path / "out.ply")
    assert not report.converged
    assert any("max_iterations" in text for text in report.warnings)


def test_what_a_format_loses_is_said(scan: Path, tmp_path: Path) -> None:
    painted = Chain([*TWIST, Step("compute_scalar_oneform_field")])
    report = painted.process(scan, tmp_path / "out.ply")
    assert (report.moved_only, report.lost) == (False, ("comments",))
    assert np.max(loaded(tmp_path / "out.ply").current_mesh().vertex_scalar_array()) == pytest.approx(np.pi / 2)
    assert "quality" in painted.process(scan, tmp_path / "out.off").lost


def test_only_moving_is_told_from_more(scan: Path) -> None:
    more = [
        Step("meshing_invert_face_orientation"),
        Step("compute_color_by_function_per_vertex", {"x": "255*z"}),
        Step("compute_scalar_by_function_per_vertex", {"q": "z"}),
        Step("meshing_surface_subdivision_midpoint", {"iterations": 1}),
        Step("create_cube"),
    ]
    assert Chain([SMOOTH, *SELECTED]).run(loaded(scan)).moved_only
    for step in more:
        assert not Chain([step]).run(loaded(scan)).moved_only


def test_nothing_is_half_written(scan: Path, tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"unknown extension '\.glb'"):
        Chain([SMOOTH]).process(scan, tmp_path / "out.glb")
    with pytest.raises(FileError, match="folder does not exist"):
        Chain([SMOOTH]).process(scan, tmp_path / "none" / "out.obj")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["scan.ply"]


def test_a_broken_file_is_named_and_the_folder_stays(tmp_path: Path) -> None:
    broken = tmp_path / "in"
    broken.mkdir()
    (broken / "bad.ply").write_text("ply\nformat nonsense\n")
    (broken / "nan.off").write_text("OFF\n3 1 0\nnan 0 0\n1 0 0\n0 1 0\n3 0 1 2\n")
    folder = os.getcwd()
    for name in ("bad.ply", "nan.off", "missing.ply"):
        with pytest.raises(FileError, match=name):
            Chain([SMOOTH]).process(broken / name, tmp_path / "out.ply")
    assert os.getcwd() == folder
    assert not (tmp_path / "out.ply").exists()


def test_source_and_target_may_be_one_file(scan: Path, tmp_path: Path) -> None:
    Chain(TWIST).process(scan, tmp_path / "out.ply")
    Chain(TWIST).process(scan, scan)
    assert scan.read_bytes() == (tmp_path / "out.ply").read_bytes()


# ------------------------------------------------------------------ files keep what they have


def test_stored_normals_turn_with_the_deformation(tmp_path: Path) -> None:
    meshes = bar()
    meshes.save_current_mesh(tmp_path / "scan.obj", save_vertex_normal=True)
    whole = Step("set_oneform_handle", {"condselect": "z > -1", "angle": 90})
    Chain([whole, TWIST[2]]).process(tmp_path / "scan.obj", tmp_path / "out.obj")
    before, after = (normals_in(tmp_path / name) for name in ("scan.obj", "out.obj"))
    assert np.allclose(after, before @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]]), atol=1e-5)
    Chain([whole, TWIST[2]]).process(tmp_path / "scan.obj", tmp_path / "kept.obj", normals="keep")
    assert np.array_equal(normals_in(tmp_path / "kept.obj"), before)


def normals_in(path: Path) -> np.ndarray:
    lines = [line.split()[1:] for line in path.read_text().splitlines() if line.startswith("vn ")]
    return np.array(lines, dtype=float)


def test_a_scene_is_written_as_a_scene(tmp_path: Path) -> None:
    x, faces = arrays_of(bar())
    scene = trimesh.Scene()
    lifted = trimesh.transformations.translation_matrix([0, 0, 5])
    scene.add_geometry(trimesh.Trimesh(x, faces, process=False), transform=lifted, node_name="arm", geom_name="arm")
    scene.add_geometry(trimesh.Trimesh(0.5 * x, faces, process=False), node_name="leg", geom_name="leg")
    scene.export(tmp_path / "scene.glb")
    arm = Chain(
        [
            Step("set_oneform_handle", {"group": "leg", "held": True}),
            Step("set_oneform_handle", {"group": "arm", "angle": 90}),
            TWIST[2],
        ]
    )
    report = arm.process(tmp_path / "scene.glb", tmp_path / "out.glb")
    assert report.moved_only
    moved = trimesh.load_scene(tmp_path / "out.glb", process=False)
    assert sorted(moved.graph.nodes_geometry) == ["arm", "leg"]
    assert np.allclose(moved.geometry["leg"].vertices, 0.5 * x, atol=1e-6)
    turned = (x - x.mean(axis=0)) @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]]) + x.mean(axis=0)
    assert np.allclose(moved.geometry["arm"].vertices, turned, atol=1e-5)
    with pytest.raises(FileError, match="changes nothing else"):
        Chain([Step("meshing_invert_face_orientation")]).process(tmp_path / "scene.glb", tmp_path / "other.glb")


def test_identity_fields_leave_every_file_as_it_was(meshes: Path, tmp_path: Path) -> None:
    identity = Chain([Step("set_oneform_handle", {"condselect": "vi == 0", "held": True}), TWIST[2]])
    checked = 0
    for path in sorted([*(meshes / "attributes").iterdir(), *(meshes / "polygons").iterdir()]):
        if path.suffix not in (".obj", ".ply", ".off", ".glb") or "point" in path.name:
            continue
        target = tmp_path / f"out{path.suffix}"
        report = identity.process(path, target)
        assert report.moved_only, path.name
        assert target.read_bytes() == path.read_bytes(), path.name
        checked += 1
    assert checked > 20


# ------------------------------------------------------------------ trimesh and plain arrays


def test_a_trimesh_keeps_what_it_has_where_only_vertices_moved() -> None:
    x, faces = arrays_of(bar())
    mesh = trimesh.Trimesh(x, faces, process=False, vertex_colors=np.full((len(x), 4), [9, 8, 7, 255], dtype=np.uint8))
    mesh.metadata["name"] = "bar"
    moved = Chain(TWIST).apply(mesh)
    assert moved is not mesh
    assert np.array_equal(mesh.vertices, x)
    assert moved.metadata["name"] == "bar"
    assert np.array_equal(moved.visual.vertex_colors, mesh.visual.vertex_colors)
    assert np.array_equal(moved.faces, mesh.faces)
    finer = Chain([Step("meshing_surface_subdivision_midpoint", {"iterations": 1})]).apply(mesh)
    assert len(finer.vertices) > len(x)
    assert np.array_equal(finer.visual.vertex_colors[0], [9, 8, 7, 255])


def test_arrays_keep_their_dtype_and_polygons() -> None:
    x, faces = arrays_of(bar())
    single, same = Chain(TWIST).apply((x.astype(np.float32), faces))
    assert single.dtype == np.float32
    assert same is faces
    quads = [[0, 1, 2, 3]]
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    lifted, kept = Chain([Step("compute_coord_by_function", {"z": "1"})]).apply((square, quads))
    assert kept is quads
    assert np.array_equal(lifted, square + [0, 0, 1])


@pytest.mark.parametrize(
    ("mesh", "word"),
    [
        ("a text", "not for str"),
        ((np.zeros((3, 2)), [[0, 1, 2]]), "vertices (3, 2)"),
        ((np.full((3, 3), np.nan), [[0, 1, 2]]), "finite"),
        ((np.zeros((3, 3)), [[0, 1, 7]]), "a face uses vertex 7 of 3"),
        ((np.zeros((3, 3)), [[0, 1, -1]]), "a face uses vertex -1"),
        ((np.zeros((3, 3)), [[0, 1]]), "three or more"),
    ],
)
def test_what_is_no_mesh_is_refused(mesh: object, word: str) -> None:
    with pytest.raises(InputError) as caught:
        Chain(TWIST).apply(mesh)
    assert word in str(caught.value)


def test_a_mesh_set_is_changed_in_place_and_warned_of() -> None:
    meshes = bar()
    before = positions(meshes)
    steps = [TWIST[0], Step("set_oneform_handle", {"condselect": "z > 0.9", "angle": 4000}), TWIST[2]]
    with pytest.warns(OneFormWarning):
        assert Chain(steps).apply(meshes) is meshes
    assert not np.array_equal(positions(meshes), before)
