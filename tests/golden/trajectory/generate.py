#!/usr/bin/env python3
"""Goldens of crates/trajectory/tests/trajectories/goldens.rs, from SciPy. Run in this folder: python3 generate.py

Every number is written by repr, so that reading it gives back the same double. See README.md.
"""

import json

import numpy as np
import scipy
from scipy.integrate import quad
from scipy.interpolate import BPoly, BSpline, CubicSpline
from scipy.linalg import expm
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation, RotationSpline, Slerp
from scipy.special import comb


def tight(spline_class):
    """RotationSpline iterated until rounding, so that its own tolerance (1e-9) is not what is compared."""

    class Tight(spline_class):
        MAX_ITER = 100
        TOL = 1e-15

    return Tight


TightSpline = tight(RotationSpline)


def write(name, content):
    content = {"scipy": scipy.__version__, "numpy": np.__version__, **content}
    with open(name, "w", newline="\n") as file:
        json.dump(content, file, separators=(",", ":"))
        file.write("\n")


def splines():
    """Both splines over uneven knots with turns up to about 100 degrees."""
    cases = []
    for seed, knots, widest in [(1, 2, 0.5), (2, 3, 0.5), (3, 4, 1.0), (4, 5, 1.7), (5, 12, 0.3), (6, 30, 1.0)]:
        rng = np.random.default_rng(seed)
        steps = rng.uniform(0.3, 2.0, knots - 1)
        at = np.concatenate([[0.0], np.cumsum(steps)])
        points = rng.normal(size=(knots, 3)) * 3
        turns = rng.normal(size=(knots - 1, 3))
        turns *= (rng.uniform(0.05, widest, knots - 1) / np.linalg.norm(turns, axis=1))[:, None]
        rotations = [Rotation.from_rotvec(rng.normal(size=3))]
        for turn in turns:
            rotations.append(rotations[-1] * Rotation.from_rotvec(turn))
        quats = np.array([r.as_quat() for r in rotations])
        # Signs at random: what a spline must not see.
        quats *= rng.choice([-1.0, 1.0], knots)[:, None]
        rotations = Rotation.from_quat(quats)
        places = [(i, u * h) for i, h in enumerate(steps) for u in (0.0, 0.21, 0.5, 0.83, 1.0)]
        s = np.array([at[i] + x for i, x in places])
        kind = "not-a-knot" if knots > 2 else "natural"
        centre = CubicSpline(at, points, bc_type=kind)
        turning = TightSpline(at, rotations)
        cases.append(
            {
                "steps": steps.tolist(),
                "points": points.tolist(),
                "quaternions_xyzw": quats.tolist(),
                "segments": [i for i, _ in places],
                "x": [float(x) for _, x in places],
                "value": centre(s).tolist(),
                "slope": centre(s, 1).tolist(),
                "rotation_xyzw": turning(s).as_quat().tolist(),
                "rate": turning(s, 1).tolist(),
                "acceleration": turning(s, 2).tolist(),
            }
        )
    write("splines.json", {"cases": cases})


def ordinary_segment(rng):
    """A cubic between two points, its length by adaptive Gauss-Kronrod quadrature."""
    slopes = rng.normal(size=(2, 3))
    ends = np.array([np.zeros(3), rng.normal(size=3)])
    curve = CubicSpline([0.0, 1.0], ends, bc_type=((1, slopes[0]), (1, slopes[1])))
    speed = lambda x: float(np.linalg.norm(curve(x, 1)))
    breaks = np.linspace(0.0, 1.0, 9)
    length = sum(quad(speed, p, q, epsabs=1e-15, epsrel=1e-13)[0] for p, q in zip(breaks, breaks[1:]))
    return ends, slopes, length


def cusp_segment(rng, slowest):
    """A parabola whose speed falls to `slowest` inside, its length in closed form.

    The velocity is (x - c) d + w with w orthogonal to d, so that its length is sqrt(a^2 y^2 + b^2) with y = x - c.
    """
    c, d = rng.uniform(0.2, 0.8), rng.normal(size=3)
    w = np.cross(d, rng.normal(size=3))
    w *= slowest / np.linalg.norm(w)
    velocity = lambda x: (x - c) * d + w
    ends = np.array([np.zeros(3), ((1 - c) ** 2 - c * c) / 2 * d + w])
    a, b = np.linalg.norm(d), np.linalg.norm(w)

    def before(y):
        flat = b * b / a * np.arcsinh(a * y / b) if b > 0 else 0.0
        return (y * np.hypot(a * y, b) + flat) / 2

    return ends, np.array([velocity(0.0), velocity(1.0)]), float(before(1 - c) - before(-c))


def lengths():
    """Lengths of cubic segments: ordinary ones, and near-cusps down to a full stop."""
    rng = np.random.default_rng(7)
    made = [("ordinary", ordinary_segment(rng)) for _ in range(40)]
    for slowest in (1e-1, 1e-2, 1e-3, 1e-4, 1e-6, 1e-9, 0.0):
        made += [("cusp", cusp_segment(rng, slowest)) for _ in range(4)]
    segments = [
        {"kind": kind, "ends": ends.tolist(), "slopes": slopes.tolist(), "length": length}
        for kind, (ends, slopes, length) in made
    ]
    write("lengths.json", {"segments": segments})


def karcher(rotations):
    mean = rotations[len(rotations) // 2]
    for _ in range(100):
        step = np.mean([(mean.inv() * r).as_rotvec() for r in rotations], axis=0)
        mean = mean * Rotation.from_rotvec(step)
        if np.linalg.norm(step) < 1e-15:
            break
    return mean


def scene_distance(centres, rotations):
    axes = np.array([r.apply([0.0, 0.0, 1.0]) for r in rotations])
    across = np.array([np.eye(3) - np.outer(d, d) for d in axes])
    rows = across.reshape(-1, 3)
    right = np.einsum("nij,nj->ni", across, centres).reshape(-1)
    point = np.linalg.lstsq(rows, right, rcond=None)[0]
    return float(np.median(np.linalg.norm(centres - point, axis=1)))


def refined():
    """The whole of pipeline section 2 in another program: orbit with jitter, w = 2, gamma = 5, default law."""
    rng = np.random.default_rng(11)
    n, window, factor = 30, 2, 5
    steps = np.clip(1 + 0.3 * rng.normal(size=n - 1), 0.2, None)
    phi = np.pi * np.concatenate([[0.0], np.cumsum(steps)]) / steps.sum()
    centres, rotations = [], []
    for angle in phi:
        centre = np.array([2 * np.cos(angle), 2 * np.sin(angle), 0.4]) + 0.005 * rng.normal(size=3)
        forward = -centre / np.linalg.norm(centre)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        look = Rotation.from_matrix(np.column_stack([right, np.cross(forward, right), forward]))
        rotations.append(look * Rotation.from_rotvec(np.deg2rad(0.5) * rng.normal(size=3)))
        centres.append(centre)
    centres = np.array(centres)
    distance = scene_distance(centres, rotations)

    windows = [range(max(0, i - window), min(n, i + window + 1)) for i in range(n)]
    smooth_centres = np.array([np.mean([centres[j] for j in w], axis=0) for w in windows])
    smooth_rotations = Rotation.concatenate([karcher([rotations[j] for j in w]) for w in windows])
    turns = (smooth_rotations[:-1].inv() * smooth_rotations[1:]).magnitude()
    deltas = turns + np.linalg.norm(np.diff(smooth_centres, axis=0), axis=1) / distance
    s = np.concatenate([[0.0], np.cumsum(deltas)])
    total = s[-1]

    curve = CubicSpline(s, smooth_centres)
    turning = TightSpline(s, smooth_rotations)

    def pace(x):
        return float(np.linalg.norm(turning(x, 1)) + np.linalg.norm(curve(x, 1)) / distance)

    def length(a, b):
        return quad(pace, a, b, epsabs=1e-13, epsrel=1e-12, limit=200)[0]

    before = np.concatenate([[0.0], np.cumsum([length(a, b) for a, b in zip(s, s[1:])])])
    count = factor * n
    u = 0.25 * np.sin(np.arange(count - 1) / (count - 1)) + 1.1
    shares = np.concatenate([[0.0], np.cumsum(u) / u.sum()])
    at = [0.0]
    for share in shares[1:-1]:
        target = share * before[-1]
        k = int(np.searchsorted(before, target, side="right")) - 1
        at.append(brentq(lambda x: before[k] + length(s[k], x) - target, s[k], s[k + 1], xtol=1e-13, rtol=1e-14))
    at.append(total)

    def poses(at):
        return [[*curve(x).tolist(), *turning(x).as_quat(canonical=True).tolist()] for x in at]

    write(
        "refined.json",
        {
            "views": [[*c.tolist(), *r.as_quat().tolist()] for c, r in zip(centres, rotations)],
            "window": window,
            "factor": factor,
            "law": "0.25*sin(t) + 1.1",
            "scale_distance": distance,
            "S": total,
            "length_ratio": before[-1] / total,
            "poses": poses(at),
            "literal_poses": poses(shares * total),
        },
    )


def hat(vector):
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def vee(matrix):
    return np.array([matrix[2, 1] - matrix[1, 2], matrix[0, 2] - matrix[2, 0], matrix[1, 0] - matrix[0, 1]]) / 2


def exponential(a, slope, bend):
    """exp(hat(r)) and its first two derivatives for r, r' and r'', by the exponential of one block matrix: a function of
    a block triangular Toeplitz matrix holds the Taylor coefficients of the function of its entries."""
    o, a, b, c = np.zeros((3, 3)), hat(a), hat(slope), hat(bend) / 2
    jet = expm(np.block([[a, b, c], [o, a, b], [o, o, a]]))[:3]
    return jet[:, :3], jet[:, 3:6], 2 * jet[:, 6:]


def times(p, q):
    """The product of two matrices with their first two derivatives."""
    return p[0] @ q[0], p[1] @ q[0] + p[0] @ q[1], p[2] @ q[0] + 2 * p[1] @ q[1] + p[0] @ q[2]


def turning(jet):
    """The rotation as a quaternion, the body rate and its derivative, of a rotation matrix with two derivatives."""
    r, slope, bend = jet
    rate = vee(r.T @ slope)
    acceleration = vee(slope.T @ slope + r.T @ bend)
    return Rotation.from_matrix(r).as_quat(), rate, acceleration


def fixed(rotation):
    return rotation.as_matrix(), np.zeros((3, 3)), np.zeros((3, 3))


def cumulative(steps, centres, rotations):
    """Centres by SciPy's B-spline; rotations as the product over all control rotations of exponentials, weighted with
    integrals of SciPy's quadratic basis elements, which are the cumulative cubic ones."""
    ends = lambda a: np.concatenate([[a[0]] * 2, a, [a[-1]] * 2])
    control = Rotation.from_quat(ends(rotations.as_quat()))
    knots = np.arange(-3.0, len(control) + 1)
    centre = BSpline(knots, ends(centres), 3)
    basis = [BSpline.basis_element(knots[j : j + 4], extrapolate=False) for j in range(1, len(control))]
    turns = (control[:-1].inv() * control[1:]).as_rotvec()

    def weights(element, t):
        start, end = element.t[2], element.t[-3]
        if t <= start:
            return 0.0, 0.0, 0.0
        if t >= end:
            return 1.0, 0.0, 0.0
        return element.integrate(start, t), float(element(t)), float(element.derivative()(t))

    def at(segment, x):
        t = segment + x
        jet = fixed(control[0])
        for element, turn in zip(basis, turns):
            jet = times(jet, exponential(*(w * turn for w in weights(element, t))))
        return centre(t), centre(t, 1), centre(t, 2), *turning(jet)

    return at, len(control) - 3


def pinned(degree, x, points):
    """Control points of the Bezier curve between the outer points that is nearest to the inner ones."""
    bernstein = np.array([[comb(degree, i) * u**i * (1 - u) ** (degree - i) for i in range(degree + 1)] for u in x])
    outer = bernstein[:, :1] * points[:1] + bernstein[:, -1:] * points[-1:]
    inner = np.linalg.lstsq(bernstein[1:-1, 1:-1], (points - outer)[1:-1], rcond=None)[0]
    return BPoly(np.concatenate([points[:1], inner, points[-1:]])[:, None, :], [0.0, 1.0])


def bezier(degree):
    def curve(steps, centres, rotations):
        before = np.concatenate([[0.0], np.cumsum(steps)])
        whole, used = before[-1], min(degree, len(steps))
        mean = karcher(list(rotations))
        vectors = (mean.inv() * rotations).as_rotvec()
        assert np.linalg.norm(vectors, axis=1).max() < 2.9
        assert np.linalg.norm(vectors.mean(axis=0)) < 1e-14
        centre = pinned(used, before / whole, centres)
        vector = pinned(used, before / whole, vectors)

        def at(segment, x):
            u = (before[segment] + x) / whole
            derivatives = lambda p: (p(u), p(u, 1) / whole, p(u, 2) / whole**2)
            return *derivatives(centre), *turning(times(fixed(mean), exponential(*derivatives(vector))))

        return at, len(steps)

    return curve


def slerp_lerp(steps, centres, rotations):
    before = np.concatenate([[0.0], np.cumsum(steps)])
    turned = Slerp(before, rotations)
    turns = (rotations[:-1].inv() * rotations[1:]).as_rotvec()

    def at(segment, x):
        t = before[segment] + x
        centre = [np.interp(t, before, column) for column in centres.T]
        rate = (centres[segment + 1] - centres[segment]) / steps[segment]
        still = np.zeros(3)
        return np.array(centre), rate, still, turned(t).as_quat(), turns[segment] / steps[segment], still

    return at, len(steps)


def curves():
    """The curves beside the cubic one: poses, rates and accelerations."""
    made = [("cumulative", None, cumulative, knots, widest) for knots, widest in [(2, 1.7), (3, 1.0), (5, 3.0), (9, 1.0)]]
    made += [("slerp-lerp", None, slerp_lerp, knots, widest) for knots, widest in [(2, 3.0), (6, 2.0)]]
    for knots, widest in [(2, 3.0), (3, 1.5), (5, 0.7), (12, 0.4)]:
        made += [("bezier", degree, bezier(degree), knots, widest) for degree in range(1, 6)]
    cases = []
    for seed, (name, degree, curve, knots, widest) in enumerate(made):
        rng = np.random.default_rng(100 + seed)
        steps = np.ones(knots - 1) if name == "cumulative" else rng.uniform(0.5, 1.6, knots - 1)
        centres = np.cumsum(rng.normal(size=(knots, 3)), axis=0)
        turns = rng.normal(size=(knots - 1, 3))
        turns *= (rng.uniform(widest / 4, widest, knots - 1) / np.linalg.norm(turns, axis=1))[:, None]
        rotations = [Rotation.from_rotvec(rng.normal(size=3))]
        for turn in turns:
            rotations.append(rotations[-1] * Rotation.from_rotvec(turn))
        rotations = Rotation.concatenate(rotations)
        at, segments = curve(steps, centres, rotations)
        lengths = np.ones(segments) if name == "cumulative" else steps
        places = [(i, float(u * h)) for i, h in enumerate(lengths) for u in (0.04, 0.37, 0.81)]
        found = [at(*place) for place in places]
        column = lambda k: [np.asarray(f[k]).tolist() for f in found]
        cases.append(
            {
                "curve": name,
                "degree": degree,
                "degree_used": degree and min(degree, knots - 1),
                "steps": steps.tolist(),
                "knots": np.concatenate([centres, rotations.as_quat()], axis=1).tolist(),
                "segments": [i for i, _ in places],
                "x": [x for _, x in places],
                "centre": column(0),
                "linear": column(1),
                "linear_slope": column(2),
                "rotation_xyzw": column(3),
                "angular": column(4),
                "angular_slope": column(5),
            }
        )
    write("curves.json", {"cases": cases})


if __name__ == "__main__":
    splines()
    lengths()
    refined()
    curves()
