"""Coverage of a plan by Monte Carlo, written from the definition alone (method section 4) and sharing nothing with the planner.

A point is measured from a viewpoint iff for the left camera, the right camera and the projector alike: it projects
inside the image (distortion included), nothing lies on the way to the optical centre, the angle between its normal and
the direction to the centre is at most the device's limit; and its depth in the scanner frame is within the working
depth. Points are drawn uniformly by area; each survivor of the cheap tests costs three any-hit rays (Embree).

    coverage_oracle.py MESH PLAN.json [--candidates POSES.json] [--largest-extent MM] [--points N] [--seed N]

MESH is the file that was planned on, in millimetres; --largest-extent scales it and puts the middle of its box at the
origin, as the planner's input was. POSES.json is a list of part_from_scanner, one for every candidate that was considered; with it `of_coverable` is
printed too. Of visible counts points from which a straight line leads out of the part; incidence is against the direction to the
viewpoint. The answer is one JSON object on standard output. Lengths in millimetres.
"""

import argparse
import json
import sys
import time

import numpy as np
import trimesh
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

# Rays start this far above the surface: single precision at the part's size is a hundred times finer.
LIFT_MM = 2e-3
BLOCK = 100_000


def load(path, largest_extent):
    """Corners of every triangle, mm; a closed body turned inside out is turned back."""
    mesh = trimesh.load(path, force="mesh", process=False)
    triangles = np.asarray(mesh.vertices, dtype=float)[np.asarray(mesh.faces)]
    if largest_extent:
        corners = triangles.reshape(-1, 3)
        low, high = corners.min(axis=0), corners.max(axis=0)
        triangles = (triangles - (low + high) / 2) * (largest_extent / (high - low).max())
    a, b, c = triangles.transpose(1, 0, 2)
    if np.einsum("ij,ij->i", a, np.cross(b, c)).sum() < 0:
        triangles = triangles[:, ::-1]
    return triangles


def sample(triangles, count, seed):
    """Points uniform by area, with unit normals, and the whole area."""
    a, b, c = triangles.transpose(1, 0, 2)
    scaled = np.cross(b - a, c - a)
    double_area = np.linalg.norm(scaled, axis=1)
    random = np.random.default_rng(seed)
    faces = random.choice(len(triangles), size=count, p=double_area / double_area.sum())
    u, v = random.random(count), random.random(count)
    over = u + v > 1
    u[over], v[over] = 1 - u[over], 1 - v[over]
    points = a[faces] + u[:, None] * (b - a)[faces] + v[:, None] * (c - a)[faces]
    return points, scaled[faces] / double_area[faces, None], double_area.sum() / 2


def matrix(pose):
    """4 × 4 matrix of a pose as plan.json writes it."""
    x, y, z, w = pose["quaternion_xyzw"]
    m = np.eye(4)
    m[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    m[:3, 3] = pose["translation_mm"]
    return m


def unfold_radius(distortion):
    """Radius at which the radial distortion first stops growing; beyond it the model says nothing."""
    k1, k2, _, _, k3 = distortion
    # d/dr of r (1 + k1 r^2 + k2 r^4 + k3 r^6), as a polynomial in r^2.
    roots = np.roots([7 * k3, 5 * k2, 3 * k1, 1])
    real = [root.real for root in roots if abs(root.imag) < 1e-12 and root.real > 0]
    return np.sqrt(min(real)) if real else np.inf


def in_image(device, points):
    """Whether points of the device frame are imaged inside the frame."""
    ahead = points[:, 2] > 0
    z = np.where(ahead, points[:, 2], 1.0)
    x, y = points[:, 0] / z, points[:, 1] / z
    k1, k2, p1, p2, k3 = device["distortion"]
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    xd = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    yd = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    u = device["fx"] * (xd + device["skew"] * yd) + device["cx"]
    v = device["fy"] * yd + device["cy"]
    inside = (u >= 0) & (u < device["width_px"]) & (v >= 0) & (v < device["height_px"])
    return ahead & inside & (np.sqrt(r2) < unfold_radius(device["distortion"]))


class Part:
    """The part as Embree sees it, moved to its middle for the sake of single precision."""

    def __init__(self, triangles):
        self.middle = (triangles.reshape(-1, 3).min(axis=0) + triangles.reshape(-1, 3).max(axis=0)) / 2
        self.scene = EmbreeScene(robust=True)
        TriangleMesh(self.scene, (triangles - self.middle).astype(np.float32))

    def free(self, points, normals, centre):
        """Whether nothing lies between each point and the centre."""
        origins = points + LIFT_MM * normals
        to_centre = centre - origins
        length = np.linalg.norm(to_centre, axis=1)
        hit = self.scene.run(
            (origins - self.middle).astype(np.float32),
            (to_centre / length[:, None]).astype(np.float32),
            dists=length.astype(np.float32),
            query="OCCLUDED",
        )
        return hit < 0


def measured(part, scanner, pose, points, normals):
    """Which points one viewpoint measures."""
    part_from_scanner = matrix(pose)
    scanner_from_part = np.linalg.inv(part_from_scanner)
    in_scanner = points @ scanner_from_part[:3, :3].T + scanner_from_part[:3, 3]
    depth = scanner["depth_mm"]
    alive = np.flatnonzero((in_scanner[:, 2] >= depth["near"]) & (in_scanner[:, 2] <= depth["far"]))
    centres = []
    for device in scanner["devices"]:
        scanner_from_device = matrix(device["scanner_from_device"])
        centre = (part_from_scanner @ scanner_from_device)[:3, 3]
        towards = centre - points[alive]
        cosine = np.einsum("ij,ij->i", normals[alive], towards) / np.linalg.norm(towards, axis=1)
        alive = alive[cosine >= np.cos(np.radians(device["incidence_max_deg"]))]
        in_device = (in_scanner[alive] - scanner_from_device[:3, 3]) @ scanner_from_device[:3, :3]
        alive = alive[in_image(device, in_device)]
        centres.append(centre)
    for centre in centres:
        alive = alive[part.free(points[alive], normals[alive], centre)]
    seen = np.zeros(len(points), dtype=bool)
    seen[alive] = True
    return seen


def union(part, scanner, poses, points, normals):
    """Which points at least one of the viewpoints measures."""
    seen = np.zeros(len(points), dtype=bool)
    for start in range(0, len(points), BLOCK):
        block = slice(start, start + BLOCK)
        for pose in poses:
            # A point that is seen already need not be looked at again.
            open_ = np.flatnonzero(~seen[block]) + start
            seen[open_] = measured(part, scanner, pose, points[open_], normals[open_])
    return seen


def squarest(part, scanner, poses, points, normals):
    """Cosine of the smallest incidence, against the direction to the viewpoint, at which each point is measured; else -1."""
    best = np.full(len(points), -1.0)
    for pose in poses:
        seen = np.flatnonzero(measured(part, scanner, pose, points, normals))
        towards = matrix(pose)[:3, 3] - points[seen]
        cosine = np.einsum("ij,ij->i", normals[seen], towards) / np.linalg.norm(towards, axis=1)
        best[seen] = np.maximum(best[seen], cosine)
    return best


def open_sky(part, points, normals, seed, directions=4096, batch=32):
    """Which points have a straight way out of the part: random directions in front of each until one is free."""
    random = np.random.default_rng(seed)
    is_open = np.zeros(len(points), dtype=bool)
    beyond = 10 * np.abs(points).max() + 1000
    for _ in range(directions // batch):
        left = np.flatnonzero(~is_open)
        for _ in range(batch if len(left) else 0):
            direction = random.normal(size=(len(left), 3))
            direction /= np.linalg.norm(direction, axis=1)[:, None]
            direction *= np.sign(np.einsum("ij,ij->i", direction, normals[left]))[:, None]
            free = part.free(points[left], normals[left], points[left] + beyond * direction)
            is_open[left[free]] = True
            left = left[~free]
            if not len(left):
                break
    return is_open


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("mesh")
    parser.add_argument("plan")
    parser.add_argument("--candidates")
    parser.add_argument("--largest-extent", type=float)
    parser.add_argument("--points", type=int, default=200_000)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    with open(args.plan) as file:
        plan = json.load(file)
    if plan["params"]["regions"]["exclude"] or plan["params"]["part"]["fixture_mesh"]:
        sys.exit("the oracle knows neither excluded regions nor fixtures")

    begin = time.monotonic()
    triangles = load(args.mesh, args.largest_extent)
    points, normals, area = sample(triangles, args.points, args.seed)
    part = Part(triangles)
    scanner = plan["scanner"]
    poses = [view["part_from_scanner"] for view in plan["viewpoints"] if view["rejected"] is None]
    covered = union(part, scanner, poses, points, normals)
    answer = {"points": args.points, "area_mm2": area, "of_asked": covered.mean()}
    # Without a plate nothing rests: visible is whatever a straight line leads out from.
    visible = covered.copy()
    rest = np.flatnonzero(~covered)
    visible[rest] = open_sky(part, points[rest], normals[rest], args.seed)
    best = squarest(part, scanner, poses, points, normals)
    answer["visible_of_asked"] = visible.mean()
    answer["of_visible"] = covered.mean() / visible.mean()
    for degrees in (35, 60):
        answer[f"within_{degrees}_deg_of_visible"] = (best >= np.cos(np.radians(degrees))).mean() / visible.mean()
    if args.candidates:
        with open(args.candidates) as file:
            coverable = union(part, scanner, json.load(file), points, normals)
        answer["coverable_of_asked"] = coverable.mean()
        answer["of_coverable"] = covered.mean() / coverable.mean()
        # Every chosen view is one of the candidates.
        answer["covered_not_coverable"] = (covered & ~coverable).mean()
    answer["seconds"] = time.monotonic() - begin
    json.dump(answer, sys.stdout)
    print()


if __name__ == "__main__":
    main()
