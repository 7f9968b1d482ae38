"""The peers written in Python, driven by tests/benches/peers.rs: one JSON request a line on standard input, one answer a
line on standard output. Arrays pass through files of raw little-endian numbers. Only the peer's own work is timed.

Open3D: RaycastingScene (Embree, one ray at a time). trimesh: RayMeshIntersector over embreex (Embree 4).
"""

import json
import sys
import time
from importlib.metadata import version

import numpy as np
import open3d
import trimesh
from trimesh.ray.ray_pyembree import RayMeshIntersector


class Clock:
    """Wall and CPU seconds, of all threads, since it was made."""

    def __init__(self):
        self.wall, self.cpu = time.perf_counter(), time.process_time()

    def read(self):
        return {"wall_s": time.perf_counter() - self.wall, "cpu_s": time.process_time() - self.cpu}


class Peers:
    def __init__(self):
        self.arrays = {}

    def mesh(self, vertices, faces):
        """The mesh that all later requests are about."""
        vertices = np.fromfile(vertices, np.float32).reshape(-1, 3)
        faces = np.fromfile(faces, np.uint32).reshape(-1, 3)
        self.triangles = len(faces)
        self.open3d = open3d.t.geometry.RaycastingScene()
        self.open3d.add_triangles(open3d.core.Tensor(vertices), open3d.core.Tensor(faces))
        self.trimesh = RayMeshIntersector(trimesh.Trimesh(vertices, faces, process=False))
        # Both build their trees at the first ray.
        probe = np.array([[0, 0, 1e3, 0, 0, 1]], np.float32)
        self.open3d.cast_rays(open3d.core.Tensor(probe))
        self.trimesh.intersects_any(probe[:, :3], probe[:, 3:])
        return {}

    def viewpoint(self, devices, seen, threads):
        """Every pixel ray of three devices: made, cast, and reduced to the triangles that each device meets."""
        generate = cast = reduce = 0.0
        masks = np.zeros((len(devices), self.triangles + 1), bool)
        clock = Clock()
        for device, mask in zip(devices, masks):
            start = time.perf_counter()
            rays = open3d.t.geometry.RaycastingScene.create_rays_pinhole(
                open3d.core.Tensor(np.array(device["intrinsic"])),
                open3d.core.Tensor(np.array(device["device_from_part"])),
                device["width_px"],
                device["height_px"],
            )
            made = time.perf_counter()
            faces = self.open3d.cast_rays(rays, nthreads=threads)["primitive_ids"].numpy().reshape(-1)
            met = time.perf_counter()
            mask[np.minimum(faces, self.triangles)] = True
            generate, cast, reduce = generate + made - start, cast + met - made, reduce + time.perf_counter() - met
        cost = clock.read()
        masks[:, : self.triangles].tofile(seen)
        return cost | {"generate_s": generate, "cast_s": cast, "reduce_s": reduce}

    def rays(self, name, origin, directions):
        """An array of rays with a common origin, kept under a name."""
        directions = np.fromfile(directions, np.float32).reshape(-1, 3)
        self.arrays[name] = np.hstack([np.broadcast_to(np.float32(origin), directions.shape), directions])
        return {}

    def first(self, peer, name, threads, answer):
        """The first triangle that each ray meets."""
        rays = self.arrays[name]
        if peer == "open3d":
            tensor = open3d.core.Tensor(rays)
            clock = Clock()
            faces = self.open3d.cast_rays(tensor, nthreads=threads)["primitive_ids"].numpy()
        else:
            clock = Clock()
            faces = self.trimesh.intersects_first(rays[:, :3], rays[:, 3:])
        cost = clock.read()
        faces.astype(np.int64).astype(np.uint32).tofile(answer)
        return cost

    def blocked(self, peer, name, end, threads, answer):
        """Whether anything lies on each ray up to `end`. trimesh knows no end: it gets the same lines from their ends
        to their origin, behind which nothing lies."""
        rays = self.arrays[name]
        if peer == "open3d":
            tensor = open3d.core.Tensor(rays)
            clock = Clock()
            blocked = self.open3d.test_occlusions(tensor, tnear=0.0, tfar=end, nthreads=threads).numpy()
        else:
            origins, directions = rays[:, :3] + np.float32(end) * rays[:, 3:], -rays[:, 3:]
            clock = Clock()
            blocked = self.trimesh.intersects_any(origins, directions)
        cost = clock.read()
        blocked.astype(bool).tofile(answer)
        return cost

    def versions(self):
        return {
            "open3d": f"Open3D {open3d.__version__}",
            "trimesh": f"trimesh {trimesh.__version__} + embreex {version('embreex')}",
        }


def main():
    peers = Peers()
    for line in sys.stdin:
        request = json.loads(line)
        answer = getattr(peers, request.pop("request"))(**request)
        print(json.dumps(answer), flush=True)


main()
