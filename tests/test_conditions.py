"""Conditions: the same vertices as MeshLab selects, and errors that say what to write instead."""

import numpy as np
import pytest

from oneform_warp.conditions import select, vertex_variables
from oneform_warp.errors import InputError

CONDITIONS = [
    "x > 0",
    "-x^2 < -0.5",
    "2^3^2 == 512",
    "2^-2^2 == 0.0625",
    "2^-1*4 == 2 && x < 0.3",
    "x < 0 && y < 0 == 1",
    "x > 0 && y > 0 || z > 0",
    "z > 0 || y > 0 && x > 0",
    "x > 0 != y > 0",
    "x > 0 < y",
    "3 > 2 > 1",
    "x > 0 ? y > 0 : z > 0",
    "x > 0 || y > 0 ? z > 0 : 0",
    "x > 0 ? 1 : y > 0 ? 1 : 0",
    "x - y - z > 0",
    "x / y / z > 0",
    "2--x > 2",
    "x > -y",
    "+x > .1",
    "x > 1.e-1",
    "min(x, max(y, z)) < 0",
    "avg(x, y, z) < sum(x, y)",
    "rint(2*x) == 0",
    "rint(0.5) == 1 && rint(-2.5) == -2",
    "sign(x)",
    "abs(x) < 0.5",
    "log(x + 2) > 0.5 && ln(x + 2) > 0.6",
    "log10(x + 2) > 0.2 || log2(x + 2) > 1",
    "exp(x) > 1 && tanh(y) < 0.3",
    "atan2(x, y) > 0.2",
    "sin(_pi*x) > cos(_e*y)",
    "_pi == 3.141592653589",
    "sqrt(x)",
    "sqrt(x) >= 0",
    "min(sqrt(x), 0.5) == 0.5",
    "max(0.2, sqrt(x)) > 0.1",
    "sign(sqrt(x)) == 0",
    "x / 0 > 0",
    "sqrt(x) && 1",
    "(-8)^(1/3) < 0",
    "x > xmid && y < ymin + 0.25*ydim",
    "z > zmax - 0.1*bbdiag",
    "bbdiag == sqrt(xdim^2 + ydim^2 + zdim^2)",
    "r > 100 && g <= 200 || b == a",
    "a > 128",
    "nx > 0 && nz < 0.5",
    "q > 0.1",
    "vi < 10 || vi/3 == rint(vi/3)",
    "vsel",
    "x\t>\n0",
    "1",
]


@pytest.fixture(scope="module")
def meshlab():
    """A MeshSet with a random mesh that has colours, normals, quality and a selection, and our variables."""
    pymeshlab = pytest.importorskip("pymeshlab", reason="pymeshlab is not installed")
    rng = np.random.default_rng(7)
    faces = np.array([rng.choice(80, 3, replace=False) for _ in range(120)])
    mesh = pymeshlab.Mesh(
        rng.uniform(-1, 1, (80, 3)),
        faces,
        v_normals_matrix=rng.normal(size=(80, 3)),
        v_color_matrix=rng.uniform(0, 1, (80, 4)),
        v_scalar_array=rng.normal(size=80),
    )
    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(mesh)
    return meshes


def restore_selection(meshes):
    """Select every third vertex, because each query replaces the selection that `vsel` reads."""
    meshes.compute_selection_by_condition_per_vertex(condselect="vi/3 == rint(vi/3)")
    return meshes.current_mesh()


@pytest.mark.parametrize("condition", CONDITIONS)
def test_selects_the_vertices_that_meshlab_selects(meshlab, condition):
    mesh = restore_selection(meshlab)
    variables = vertex_variables(
        mesh.vertex_matrix(),
        colors=mesh.vertex_color_matrix(),
        normals=mesh.vertex_normal_matrix(),
        quality=mesh.vertex_scalar_array(),
        selected=mesh.vertex_selection_array(),
    )
    meshlab.compute_selection_by_condition_per_vertex(condselect=condition)
    expected = meshlab.current_mesh().vertex_selection_array()
    np.testing.assert_array_equal(select(condition, variables), expected)


@pytest.mark.parametrize(
    ("condition", "message"),
    [
        ("xmim > 0", "unknown variable 'xmim' at column 1; did you mean 'xmin'"),
        ("x > sqr(y)", "unknown function 'sqr' at column 5; did you mean 'sqrt'"),
        ("sin > 0", r"write sin\("),
        ("sin(x, y) > 0", "'sin' at column 1 has 2 arguments; give 1"),
        ("q > 0", "the mesh has no quality for 'q'"),
        ("x > 0 and y > 0", "unexpected 'and' at column 7; write && instead"),
        ("x = 0", "unexpected '=' at column 3; write == "),
        ("!x", "unexpected '!' at column 1"),
        ("x > 0, y > 0", "unexpected ',' at column 6"),
        ("x > (0", "condition 'x > \\(0': unexpected end at column 7"),
        ("--x > 0", "unexpected '-' at column 2"),
        ("2x > 0", "unexpected 'x' at column 2"),
        ("", "unexpected end at column 1"),
        ("__import__('os')", "unexpected ''' at column 12"),
    ],
)
def test_a_mistake_is_named_with_its_column(condition, message):
    with pytest.raises(InputError, match=message):
        select(condition, vertex_variables(np.eye(3)))


def test_colours_in_bytes_and_in_fractions_are_the_same():
    bytes_ = np.array([[0, 51, 255], [255, 102, 0]], dtype=np.uint8)
    for colors in (bytes_, bytes_ / 255):
        named = vertex_variables(np.eye(3)[:2], colors=colors)
        assert [named[name].tolist() for name in "rgba"] == [[0, 255], [51, 102], [255, 0], [255, 255]]


def test_a_plane_graph_has_z_zero_and_own_names_can_be_added():
    named = vertex_variables([[0, 0], [2, 1]]) | {"heat": np.array([3.0, 4.0])}
    assert select("z == 0 && xdim == 2 && heat > 3", named).tolist() == [False, True]


def test_arrays_of_different_lengths_are_refused():
    with pytest.raises(InputError, match="one common length"):
        select("x > 0", {"x": np.zeros(3), "y": np.zeros(4)})
    with pytest.raises(InputError, match="positions"):
        vertex_variables(np.zeros((4, 5)))
