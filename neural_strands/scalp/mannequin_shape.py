"""The mannequin's solid as a signed distance: ellipsoids and tapered capsules, smoothly blended. Metres throughout."""

import numpy as np

Vector = tuple[float, float, float]


def mannequin_distance(points: np.ndarray) -> np.ndarray:
    """Approximate signed distance (n,) of points (n, 3), negative inside; symmetric in x."""
    p = points.copy()
    p[:, 0] = np.abs(p[:, 0])
    head = _features(p, _skull(p))
    body = _blend(_neck(p), _shoulders(p), 0.05)
    whole = _blend(head, body, 0.025)
    whole = _blend(whole, _ear(p), 0.006)
    return _cut(whole, -0.268 - p[:, 1], 0.012)


def _skull(p: np.ndarray) -> np.ndarray:
    """Cranium, face, jaw and chin."""
    cranium = _ellipsoid(p, (0, 0.034, -0.014), (0.0755, 0.086, 0.0955))
    forehead = _ellipsoid(p, (0, 0.030, 0.026), (0.060, 0.062, 0.066))
    face = _ellipsoid(p, (0, -0.030, 0.020), (0.060, 0.078, 0.070))
    jaw = _ellipsoid(p, (0, -0.066, 0.030), (0.046, 0.042, 0.054))
    angle = _capsule(p, (0.047, -0.052, -0.004), (0.022, -0.092, 0.058), 0.013, 0.012)
    chin = _ellipsoid(p, (0, -0.096, 0.071), (0.019, 0.015, 0.015))
    d = _blend(_blend(cranium, forehead, 0.02), face, 0.03)
    d = _blend(d, jaw, 0.025)
    d = _blend(d, angle, 0.022)
    return _blend(d, chin, 0.022)


def _features(p: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Brow, sockets, eyelids, cheeks, nose and lips."""
    d = _blend(d, _ellipsoid(p, (0.047, -0.020, 0.056), (0.017, 0.015, 0.017)), 0.03)
    d = _blend(d, _capsule(p, (0.012, 0.021, 0.0865), (0.046, 0.022, 0.067), 0.006, 0.006), 0.016)
    d = _cut(d, -_ellipsoid(p, (0.0315, 0.000, 0.0965), (0.019, 0.0125, 0.021)), 0.014)
    d = _blend(d, _ellipsoid(p, (0.0315, -0.001, 0.0705), (0.0145, 0.0105, 0.0125)), 0.004)
    d = _blend(d, _capsule(p, (0, 0.016, 0.0865), (0, -0.031, 0.1065), 0.0065, 0.0088), 0.012)
    d = _blend(d, _ellipsoid(p, (0.0105, -0.0345, 0.0975), (0.0065, 0.0065, 0.0085)), 0.007)
    d = _blend(d, _ellipsoid(p, (0, -0.064, 0.082), (0.026, 0.018, 0.012)), 0.014)
    d = _cut(d, -_capsule(p, (0, -0.0645, 0.0985), (0.022, -0.0655, 0.0865), 0.0018, 0.0012), 0.006)
    upper = _capsule(p, (0.004, -0.0600, 0.0918), (0.0185, -0.0638, 0.0842), 0.0042, 0.0020)
    lower = _capsule(p, (0.000, -0.0705, 0.0905), (0.0160, -0.0675, 0.0840), 0.0052, 0.0022)
    d = _blend(d, upper, 0.005)
    return _blend(d, lower, 0.005)


def _ear(p: np.ndarray) -> np.ndarray:
    """A flat shell leaning back and out, hollowed from the side."""
    centre = np.array([0.0775, -0.010, -0.014])
    q = _turn(_turn(p - centre, 1, 0.42), 0, -0.20)
    shell = _ellipsoid(q, (0, 0, 0), (0.0075, 0.031, 0.0185))
    lobe = _ellipsoid(q, (-0.001, -0.0245, 0.006), (0.006, 0.010, 0.009))
    d = _blend(shell, lobe, 0.006)
    return _cut(d, -_ellipsoid(q, (0.0085, 0.001, 0.003), (0.0065, 0.0195, 0.0105)), 0.005)


def _neck(p: np.ndarray) -> np.ndarray:
    column = _capsule(p, (0, -0.040, -0.026), (0, -0.200, -0.050), 0.051, 0.056)
    muscle = _capsule(p, (0.052, -0.055, -0.028), (0.014, -0.198, 0.008), 0.012, 0.012)
    return _blend(column, muscle, 0.02)


def _shoulders(p: np.ndarray) -> np.ndarray:
    slope = _capsule(p, (0.020, -0.165, -0.058), (0.160, -0.228, -0.050), 0.046, 0.047)
    chest = _ellipsoid(p, (0, -0.310, -0.036), (0.180, 0.115, 0.088))
    collar = _capsule(p, (0.016, -0.212, 0.018), (0.140, -0.205, -0.030), 0.011, 0.011)
    d = _blend(slope, chest, 0.05)
    return _blend(d, collar, 0.022)


def _ellipsoid(p: np.ndarray, centre: Vector, radii: Vector) -> np.ndarray:
    """First-order distance to an ellipsoid: exact on its surface."""
    q = (p - np.array(centre)) / np.array(radii)
    k = np.linalg.norm(q, axis=1)
    steep = np.linalg.norm(q / np.array(radii), axis=1)
    return k * (k - 1.0) / np.maximum(steep, 1e-9)


def _capsule(p: np.ndarray, start: Vector, end: Vector, start_radius: float, end_radius: float) -> np.ndarray:
    """Distance to a segment less a radius that changes linearly along it."""
    axis = np.array(end) - np.array(start)
    offset = p - np.array(start)
    along = np.clip(offset @ axis / (axis @ axis), 0.0, 1.0)
    gap = np.linalg.norm(offset - along[:, None] * axis, axis=1)
    return gap - (start_radius + (end_radius - start_radius) * along)


def _blend(a: np.ndarray, b: np.ndarray, width: float) -> np.ndarray:
    """Smooth union: a quadratic fillet of this width."""
    overlap = np.maximum(width - np.abs(a - b), 0.0) / width
    return np.minimum(a, b) - overlap * overlap * width / 4


def _cut(a: np.ndarray, b: np.ndarray, width: float) -> np.ndarray:
    """Smooth intersection."""
    return -_blend(-a, -b, width)


def _turn(p: np.ndarray, axis: int, angle: float) -> np.ndarray:
    """Rotate points by `angle` radians about a coordinate axis."""
    first, second = (axis + 1) % 3, (axis + 2) % 3
    q = p.copy()
    q[:, first] = np.cos(angle) * p[:, first] - np.sin(angle) * p[:, second]
    q[:, second] = np.sin(angle) * p[:, first] + np.cos(angle) * p[:, second]
    return q
