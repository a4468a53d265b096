"""Sequences: the ends are what they should be to the last bit, and the way between them is straight in the log fields."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import oneform_warp as ow
from oneform_warp.between import at_rest, between, constraint_at, fields_at
from oneform_warp.constraints import edge_length, linear
from oneform_warp.errors import InputError
from oneform_warp.sequences import Keyframes
from oneform_warp.solvers import SuperLU

X, FACES = ow.shapes.bar(segments=10, sides=2)
LOW, HIGH = X[:, 2] < 0.15, X[:, 2] > 0.85
MIDDLE = np.abs(X[:, 2] - 0.5) < 0.06
HELD = ow.Handle(LOW, held=True, name="low")
ROUNDING = 1e-12  # closed forms of a unit box in float64
FIELD = 1e-6  # two solves to the solver's relative residual

SHIFTED = np.array([0.3, 0.1, -0.2])
FRAME = Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix()


def top(**what):
    return ow.Handle(HIGH, name="top", **what)


ASKED = {
    "twist": [HELD, top(axis="z", angle=180)],
    "two turns": [HELD, top(axis="z", angle=720)],
    "stretch": [HELD, top(stretch=2.0)],
    "free rotation": [HELD, top(rotation=None, stretch=1.5)],
    "three handles": [HELD, ow.Handle(MIDDLE, stretch=0.5, rotation=None), top(axis="x", angle=40)],
    "moved": [HELD, top(move=SHIFTED)],
    "pivot": [HELD, top(axis="x", angle=70, pivot=(0.0, 0.0, 0.5))],
    "targets": [HELD, top(axis="z", angle=90, to=X[HIGH] @ Rotation.from_rotvec([0, 0, 1.5]).as_matrix().T + SHIFTED)],
    "fitted": [HELD, top(rotation="fit", to=X[HIGH] + SHIFTED)],
    "soft": [HELD, top(move=SHIFTED, weight=3.0)],
    "snapped": [HELD, top(move=SHIFTED, snap=True)],
    "nothing held": [top(axis="y", angle=30), ow.Handle(LOW, axis="y", angle=-30)],
}


@pytest.fixture(scope="module")
def deformer():
    return ow.Deformer(X, FACES, device="cpu")


@pytest.mark.parametrize("asked", ASKED)
def test_the_last_frame_is_the_one_off_result_bit_for_bit(deformer, asked):
    handles = ASKED[asked]
    frames = [frame.x for frame in Keyframes(deformer, handles).frames(4)]
    once = ow.Deformer(X, FACES, device="cpu").solve(handles).x
    assert np.abs(once - X).max() > 0.01
    assert frames[-1].tobytes() == once.tobytes()
    assert np.abs(frames[1] - frames[2]).max() > 1e-3


@pytest.mark.parametrize("options", [{"length": 0.3}, {"sweeps": 5}, {"start": "maximal"}, {"refine": 2}])
def test_options_reach_every_frame(deformer, options):
    handles = ASKED["twist"]
    frames = [frame.x for frame in Keyframes(deformer, handles).frames(3, **options)]
    assert frames[-1].tobytes() == ow.Deformer(X, FACES, device="cpu").solve(handles, **options).x.tobytes()
    plain = [frame.x for frame in Keyframes(deformer, handles).frames(3)]
    if "start" not in options:
        assert np.abs(frames[1] - plain[1]).max() > 1e-4


@pytest.mark.parametrize("asked", ASKED)
def test_the_first_frame_is_the_rest_pose_bit_for_bit(deformer, asked):
    assert Keyframes(deformer, ASKED[asked]).solve(0.0).x.tobytes() == X.tobytes()


@given(st.floats(0.05, 0.95), st.floats(-900, 900), st.floats(0.3, 3.0))
def test_the_log_fields_are_scaled_by_t(deformer, t, angle, stretch):
    # The third handle keeps omega and sigma from being constant in space.
    handles = [HELD, top(axis=(1, 2, 3), angle=angle, stretch=stretch), ow.Handle(MIDDLE, axis="y", angle=20)]
    keyframes = Keyframes(deformer, handles)
    now, end = keyframes.solve(t), keyframes.solve(1.0)
    scale = max(np.abs(end.omega).max(), 1.0)
    np.testing.assert_allclose(now.omega, t * end.omega, atol=FIELD * scale)
    np.testing.assert_allclose(np.log(now.sigma), t * np.log(end.sigma), atol=FIELD)


def test_half_of_two_turns_is_one(deformer):
    half = Keyframes(deformer, ASKED["two turns"]).handles(0.5)[1]
    np.testing.assert_allclose(half.rotation, [0, 0, 2 * np.pi], rtol=ROUNDING)


def test_all_frames_share_what_is_prepared():
    class Counting(SuperLU):
        prepared = 0

        def prepare(self, *arguments, **options):
            Counting.prepared += 1
            return super().prepare(*arguments, **options)

    deformer = ow.Deformer(X, FACES, solver=Counting(), device="cpu")
    for frame in Keyframes(deformer, {0.4: ASKED["twist"], 1.0: ASKED["two turns"]}).frames(9):
        assert frame.converged
    assert Counting.prepared == 2  # one for the fields, one for the positions


def test_frames_at_keys_are_their_one_off_results(deformer):
    keys = {0.25: [top(axis="z", angle=90), HELD], 0.5: [HELD, top(axis="x", angle=90)], 0.75: ASKED["stretch"]}
    keyframes = Keyframes(deformer, keys)
    assert keyframes.times == (0.0, 0.25, 0.5, 0.75)
    for t, handles in keys.items():
        once = ow.Deformer(X, FACES, device="cpu").solve(handles).x
        assert keyframes.solve(t).x.tobytes() == once.tobytes()
    assert keyframes.solve(1.0).x.tobytes() == keyframes.solve(0.75).x.tobytes()
    between = keyframes.handles(0.375)[1]
    np.testing.assert_allclose(between.rotation, [np.pi / 4, 0, np.pi / 4], rtol=ROUNDING)
    np.testing.assert_allclose(keyframes.handles(0.625)[1].stretch, np.sqrt(2.0), rtol=ROUNDING)


def test_a_handle_left_out_of_a_key_is_on_its_way_between_its_own(deformer):
    middle = ow.Handle(MIDDLE, axis="x", angle=60, name="middle")
    keyframes = Keyframes(deformer, {0.5: [HELD, middle], 1.0: [HELD, top(axis="z", angle=90)]})
    handles = {handle.name: handle for handle in keyframes.handles(0.5)}
    assert handles["middle"] is middle
    later = Keyframes(deformer, {0.5: [middle], 1.0: [HELD, middle.turned(np.zeros(3)), top()]})
    assert any(handle is middle for handle in later.handles(0.5))
    np.testing.assert_allclose(handles["top"].rotation, [0, 0, np.pi / 4], rtol=ROUNDING)
    assert {handle.name: handle for handle in keyframes.handles(1.0)}["middle"] is middle


def test_a_key_at_the_start_takes_the_place_of_rest(deformer):
    keyframes = Keyframes(deformer, {0.0: ASKED["twist"], 1.0: [HELD, top(axis="z", angle=-180)]})
    once = ow.Deformer(X, FACES, device="cpu").solve(ASKED["twist"]).x
    assert keyframes.solve(0.0).x.tobytes() == once.tobytes()
    # Half-way back the angle is 0.
    assert np.abs(keyframes.solve(0.5).x - X).max() < FIELD


def test_handles_without_names_are_known_by_their_vertices(deformer):
    keys = {0.5: [ow.Handle(HIGH, axis="z", angle=90)], 1.0: [ow.Handle(HIGH, axis="z", angle=180), HELD]}
    keyframes = Keyframes(deformer, keys)
    assert len(keyframes.handles(1.0)) == 2
    assert any(np.allclose(handle.rotation, [0, 0, 0.75 * np.pi]) for handle in keyframes.handles(0.75))


@given(st.floats(0.02, 0.98), st.floats(-400, 400), st.permutations(range(int(HIGH.sum()))))
def test_targets_of_a_rigid_motion_are_reached_rigidly(deformer, t, angle, order):
    listed = np.flatnonzero(HIGH)[list(order)]
    x = X[listed]
    turn = Rotation.from_rotvec(np.radians(angle) * np.array([0.0, 0.6, 0.8]))
    y = turn.apply(x) + SHIFTED
    handle = ow.Handle(listed, axis=(0, 0.6, 0.8), angle=angle, to=y)
    now = Keyframes(deformer, [HELD, handle]).handles(t)[1]
    part = Rotation.from_rotvec(t * np.radians(angle) * np.array([0.0, 0.6, 0.8]))
    centre = (1 - t) * x.mean(axis=0) + t * y.mean(axis=0)
    np.testing.assert_allclose(now.to, part.apply(x - x.mean(axis=0)) + centre, atol=ROUNDING)


@given(st.floats(0.02, 0.98))
def test_targets_without_a_rotation_are_reached_straight(deformer, t):
    y = X[HIGH] * [2.0, 0.5, 1.0] + SHIFTED
    for handle in (top(to=y), top(to=y, rotation=None, stretch=None)):
        now = Keyframes(deformer, [HELD, handle]).handles(t)[1]
        np.testing.assert_allclose(now.to, (1 - t) * X[HIGH] + t * y, atol=ROUNDING)


def test_a_pivot_is_what_the_handle_turns_about_all_the_way(deformer):
    handle = top(axis="x", angle=180, pivot=(0.0, 0.0, 0.5), move=(0.2, 0.0, 0.0))
    frame = Keyframes(deformer, [HELD, handle]).solve(0.5)
    turned = Rotation.from_rotvec([np.pi / 2, 0, 0]).apply(X[HIGH] - [0, 0, 0.5]) + [0.1, 0, 0.5]
    np.testing.assert_allclose(frame.x[HIGH], turned, atol=ROUNDING)


def test_targets_and_motions_mix(deformer):
    keys = {0.5: [HELD, top(to=X[HIGH] + SHIFTED)], 1.0: [HELD, top(move=3 * SHIFTED)]}
    now = Keyframes(deformer, keys).handles(0.75)[1]
    np.testing.assert_allclose(now.to, X[HIGH] + 2 * SHIFTED, atol=ROUNDING)


def test_the_stretches_of_two_frames_meet_in_their_logarithms(deformer):
    a, b = top(stretch=(2.0, 1.0, 0.5), frame=FRAME), top(stretch=(1.0, 3.0, 1.0))
    logs = FRAME @ np.diag(np.log([2.0, 1.0, 0.5])) @ FRAME.T
    rest = at_rest(a, deformer.rest)
    for start, end, s, expected in (
        (rest, a, 0.4, 0.4 * logs),
        (a, b, 0.5, 0.5 * logs + 0.5 * np.diag([0, np.log(3), 0])),
        (top(stretch=2.0), b, 0.25, np.diag(np.log([2.0, 2.0, 2.0]) * 0.75 + [0, np.log(3) / 4, 0])),
    ):
        now = between(start, end, s, deformer.rest)
        found = now.frame @ np.diag(np.log(now.stretch)) @ now.frame.T
        np.testing.assert_allclose(found, expected, atol=ROUNDING)


def test_painted_fields_are_scaled_too(deformer):
    omega, sigma = np.outer(X[:, 2] ** 2, [0, 0, 7.0]), 1.0 + X[:, 2]
    keyframes = Keyframes(deformer, [HELD])
    end = keyframes.solve(1.0, fields=ow.Fields(omega, sigma))
    assert end.x.tobytes() == deformer.solve([HELD], fields=ow.Fields(omega, sigma)).x.tobytes()
    now = keyframes.solve(0.25, fields=ow.Fields(omega, sigma))
    np.testing.assert_allclose(now.omega, 0.25 * omega, rtol=ROUNDING)
    np.testing.assert_allclose(now.sigma, sigma**0.25, rtol=ROUNDING)


@given(st.floats(0.0, 1.0))
def test_constraints_go_straight_from_rest(deformer, t):
    low, high = 0, len(X) - 2
    matrix = np.zeros((2, X.size))
    matrix[0, 3 * low], matrix[1, 3 * high + 2], matrix[1, 3 * low + 1] = 2.0, 1.0, -1.0
    asked = linear(matrix, [5.0, 7.0])
    now = constraint_at(asked, t, deformer.rest)
    np.testing.assert_allclose(now.d, (1 - t) * matrix @ X.ravel() + t * asked.d, atol=ROUNDING)
    assert constraint_at(asked, 1.0, deformer.rest) is asked
    length = constraint_at(edge_length(low, high, 3.0), t, deformer.rest)
    np.testing.assert_allclose(length.d, [(1 - t) * np.linalg.norm(X[high] - X[low]) + 3 * t], atol=ROUNDING)


def test_the_plane_has_sequences_too():
    x, faces = ow.shapes.grid(5, 4)
    x = np.ascontiguousarray(x[:, :2])
    left, right = x[:, 0] < x[:, 0].min() + 1e-9, x[:, 0] > x[:, 0].max() - 1e-9
    handles = [ow.Handle(left, held=True), ow.Handle(right, angle=90, to=x[right] + [0.1, 0.2])]
    frames = [frame.x for frame in Keyframes(ow.Deformer(x, faces, device="cpu"), handles).frames(3)]
    assert frames[0].tobytes() == x.tobytes()
    assert frames[-1].tobytes() == ow.Deformer(x, faces, device="cpu").solve(handles).x.tobytes()
    assert frames[1].shape == x.shape


@pytest.mark.parametrize(
    ("keys", "text"),
    [
        ({1.5: [HELD]}, "the time is 1.5"),
        ({"soon": [HELD]}, "the time is 'soon'"),
        ({float("nan"): [HELD]}, "the time is nan"),
        ({1.0: [HELD, HELD]}, "handle 'low'.*twice"),
        ({0.5: [top(axis="z", angle=1)], 1.0: [ow.Handle(MIDDLE, name="top")]}, "handle 'top'.*other vertices"),
        ({0.5: [top(axis="z", angle=1)], 1.0: [top(rotation=None)]}, "handle 'top'.*takes hold in another way"),
        ({0.5: [top()], 1.0: [top(move=SHIFTED)]}, "handle 'top'.*takes hold in another way"),
        ({1.0: [ow.Handle([], name="none")]}, "handle 'none'.*no vertex"),
        ({0.5: [top(axis="z", angle=9)], 1.0: [ow.Handle(HIGH, name="other")]}, "different rotations"),
    ],
)
def test_keys_that_make_no_sequence_are_errors(deformer, keys, text):
    with pytest.raises(InputError) as error:
        Keyframes(deformer, keys)
    assert re.search(text, str(error.value)), str(error.value)


@pytest.mark.parametrize("times", [1, 0, [0.0, 1.1], [-0.1]])
def test_frames_outside_the_sequence_are_errors(deformer, times):
    with pytest.raises(InputError):
        list(Keyframes(deformer, ASKED["twist"]).frames(times))


def test_fields_with_directions_go_part_of_the_way() -> None:
    rng = np.random.default_rng(4)
    half = np.eye(3) + 0.2 * rng.normal(size=(5, 3, 3))
    stretch = half @ half.transpose(0, 2, 1)
    there = fields_at(ow.Fields(stretch=stretch), 0.5).stretch
    assert np.allclose(there @ there, stretch, atol=1e-12)
    assert np.allclose(there, there.transpose(0, 2, 1), atol=1e-12)
