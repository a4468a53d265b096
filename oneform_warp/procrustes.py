"""The rotation nearest to a matrix, as a Warp function for any kernel."""

import warp as wp

__all__ = ["nearest_rotation"]

STEPS = wp.constant(50)
"""Newton's method needs 3 to 8; near two equal largest roots it halves the error in each step."""

ROOT_ERROR = wp.constant(wp.float64(1.0e-15))

KEEP = wp.constant(wp.float64(1.0e-8))
"""How much of the old rotation is added, relative to |B|: it decides where B leaves the rotation open."""

OPEN = wp.constant(wp.float64(1.0e-5))
"""(s_2 + s_3)(s_3 + s_1)(s_1 + s_2) of |B| = 1; below it the closed form loses its digits."""


@wp.func
def by_singular_values(b: wp.mat33d) -> wp.mat33d:
    """The same by B = U S V^T: slow, and right where the two smallest singular values nearly cancel."""
    u, _, v = wp.svd3(b)
    sign = wp.sign(wp.determinant(u) * wp.determinant(v))
    return u * wp.diag(wp.vec3d(wp.float64(1.0), wp.float64(1.0), sign)) * wp.transpose(v)


@wp.func
def cofactors(b: wp.mat33d) -> wp.mat33d:
    """The cofactor matrix: det(B) B^-T for a regular B."""
    x = wp.vec3d(b[0, 0], b[0, 1], b[0, 2])
    y = wp.vec3d(b[1, 0], b[1, 1], b[1, 2])
    z = wp.vec3d(b[2, 0], b[2, 1], b[2, 2])
    return wp.matrix_from_rows(wp.cross(y, z), wp.cross(z, x), wp.cross(x, y))


@wp.func
def largest_root(square: wp.float64, cofactor: wp.float64, det: wp.float64, start: wp.float64) -> wp.float64:
    """The largest root of (l^2 - |B|^2)^2 - 8 det l - 4 |cof B|^2, by Newton's method.

    It is s_1 + s_2 + s_3 of the singular values, the last one with the sign of det. start: at or above it, or between
    it and the next largest root and where the polynomial rises.
    """
    root = start
    for _ in range(STEPS):
        middle = root * root - square
        value = middle * middle - wp.float64(8.0) * det * root - wp.float64(4.0) * cofactor
        slope = wp.float64(4.0) * middle * root - wp.float64(8.0) * det
        if slope <= wp.float64(0.0):
            break
        step = value / slope
        root -= step
        if wp.abs(step) <= ROOT_ERROR * root:
            break
    return root


@wp.func
def nearest_rotation(b: wp.mat33d, old: wp.mat33d) -> wp.mat33d:
    """R with the largest tr(R^T B), det R = 1; `old` decides where B leaves it open, as on a line of vertices.

    B: any (3, 3) float64 matrix, as sum w d s^T for the best R with d = R s. No eigenvectors and no start near the
    answer are needed. Source: Markley 1993 (FOAM).
    """
    size = wp.sqrt(wp.ddot(b, b))
    if size == wp.float64(0.0):
        return old
    m = (wp.float64(1.0) / size) * b + KEEP * old
    square = wp.ddot(m, m)
    cof = cofactors(m)
    det = m[0, 0] * cof[0, 0] + m[0, 1] * cof[0, 1] + m[0, 2] * cof[0, 2]
    # The old rotation gives a lower bound, nearly sharp where little turned; above |B| no other root can be met.
    start = wp.ddot(old, m)
    if start * start <= square or start * (start * start - square) <= wp.float64(2.0) * det:
        start = wp.sqrt(wp.float64(3.0) * square)
    root = largest_root(square, wp.ddot(cof, cof), det, start)
    kappa = (root * root - square) / wp.float64(2.0)
    zeta = kappa * root - det
    if not zeta > OPEN:
        return by_singular_values(m)
    return (wp.float64(1.0) / zeta) * ((kappa + square) * m + root * cof - m * wp.transpose(m) * m)
