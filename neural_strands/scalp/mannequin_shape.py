"""The mannequin's solid as a signed distance: ellipsoids and tapered capsules, smoothly blended. Metres throughout."""

import numpy as np

Vector = tuple[float, float, float]


def mannequin_distance(points: np.ndarray) -> np.ndarray:
    """Approximate signed distance (n,) of points (n, 3), negative inside; symmetric in x."""
    p = points.copy()
    p[:, 0] = np.abs(p[:, 0])
    head = _skull(p)
    front = (p[:, 2] > 0.02) & (p[:, 1] > -0.10) & (p[:, 1] < 0.05) & (p[:, 0] < 0.09)
    head[front] = _features(p[front], head[front])
    body = _blend(_neck(p), _shoulders(p), 0.05)
    whole = _blend(head, body, 0.025)
    whole = _blend(whole, _ear(p), 0.006)
    return _cut(whole, -0.268 - p[:, 1], 0.012)


def _skull(p: np.ndarray) -> np.ndarray:
    """Cranium, face, jaw and chin."""
    cranium = _ellipsoid(p, (0.0, 0.034, -0.014), (0.0755, 0.086, 0.0955))
    forehead = _ellipsoid(p, (0.0, 0.030, 0.026), (0.060, 0.062, 0.066))
    face = _ellipsoid(p, (0.0, -0.030, 0.020), (0.056, 0.078, 0.066))
    jaw = _ellipsoid(p, (0.0, -0.066, 0.030), (0.041, 0.040, 0.049))
    angle = _capsule(p, (0.043, -0.050, 0.000), (0.016, -0.095, 0.060), 0.012, 0.011)
    chin = _ellipsoid(p, (0.0, -0.0960, 0.068), (0.016, 0.0135, 0.0145))
    d = _blend(_blend(cranium, forehead, 0.02), face, 0.03)
    d = _blend(d, jaw, 0.025)
    d = _blend(d, angle, 0.022)
    return _blend(d, chin, 0.022)


def _features(p: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Brow, sockets, closed eyes, cheeks, nose and lips; nothing finer than the mesh resolves."""
    d = _blend(d, _ellipsoid(p, (0.047, -0.020, 0.055), (0.017, 0.015, 0.017)), 0.03)
    d = _blend(d, _capsule(p, (0.012, 0.0205, 0.0865), (0.046, 0.0215, 0.067), 0.0055, 0.0055), 0.016)
    d = _cut(d, -_ellipsoid(p, (0.0310, 0.001, 0.0950), (0.0185, 0.0130, 0.0240)), 0.012)
    d = _blend(d, _ellipsoid(p, (0.0315, -0.0015, 0.0680), (0.0155, 0.0108, 0.0130)), 0.006)
    d = _blend(d, _capsule(p, (0.0, 0.016, 0.0865), (0.0, -0.028, 0.1020), 0.0062, 0.0080), 0.012)
    d = _blend(d, _ellipsoid(p, (0.0095, -0.0320, 0.0920), (0.0068, 0.0060, 0.0090)), 0.008)
    d = _blend(d, _ellipsoid(p, (0.0, -0.064, 0.0740), (0.025, 0.017, 0.0105)), 0.012)
    upper = _capsule(p, (0.0035, -0.0590, 0.0868), (0.0215, -0.0650, 0.0812), 0.0050, 0.0030)
    lower = _capsule(p, (0.0000, -0.0715, 0.0848), (0.0180, -0.0690, 0.0805), 0.0060, 0.0036)
    return _blend(d, _blend(upper, lower, 0.002), 0.006)


def _ear(p: np.ndarray) -> np.ndarray:
    """A flat shell leaning back and out, hollowed from the side."""
    centre = np.array([0.0765, -0.008, -0.012])
    q = _turn(_turn(p - centre, 1, 0.42), 0, -0.20)
    shell = _ellipsoid(q, (0.0, 0.002, 0.0), (0.0075, 0.029, 0.0185))
    lobe = _ellipsoid(q, (-0.001, -0.0215, 0.006), (0.0065, 0.011, 0.0095))
    d = _blend(shell, lobe, 0.010)
    return _cut(d, -_ellipsoid(q, (0.0105, 0.001, 0.0035), (0.0070, 0.0170, 0.0095)), 0.006)


def _neck(p: np.ndarray) -> np.ndarray:
    column = _capsule(p, (0.0, -0.040, -0.026), (0.0, -0.200, -0.046), 0.046, 0.050)
    muscle = _capsule(p, (0.046, -0.055, -0.026), (0.012, -0.205, 0.006), 0.011, 0.010)
    return _blend(column, muscle, 0.02)


def _shoulders(p: np.ndarray) -> np.ndarray:
    slope = _capsule(p, (0.018, -0.178, -0.056), (0.155, -0.238, -0.048), 0.043, 0.045)
    chest = _ellipsoid(p, (0.0, -0.318, -0.038), (0.175, 0.115, 0.082))
    collar = _capsule(p, (0.016, -0.220, 0.014), (0.140, -0.214, -0.030), 0.010, 0.010)
    d = _blend(slope, chest, 0.05)
    return _blend(d, collar, 0.022)


def _ellipsoid(p: np.ndarray, centre: Vector, radii: Vector) -> np.ndarray:
    """First-order distance to an ellipsoid: exact on its surface."""
    q = (p - np.array(centre)) / np.array(radii)
    k = _norm(q)
    steep = _norm(q / np.array(radii))
    return k * (k - 1.0) / np.maximum(steep, 1e-9)


def _capsule(p: np.ndarray, start: Vector, end: Vector, start_radius: float, end_radius: float) -> np.ndarray:
    """Distance to a segment less a radius that changes linearly along it."""
    axis = np.array(end) - np.array(start)
    offset = p - np.array(start)
    along = np.clip(offset @ axis / (axis @ axis), 0.0, 1.0)
    gap = _norm(offset - along[:, None] * axis)
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


def _norm(p: np.ndarray) -> np.ndarray:
    return np.sqrt(np.einsum("nk,nk->n", p, p))
