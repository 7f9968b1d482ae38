"""Poses of MobMonRob/ViewPathPlaning (Apache-2.0), for tests/benches/view_planners: python view_path_planing.py CHECKOUT
MESH METRES_PER_UNIT OUT. Runs the peer's phase 1 as it is, on the mesh and scale given, and the greedy cover of its
phase 2, in the peer's own virtual environment; writes OUT/part.stl (mm, turned as the peer turns it) and OUT/peer.json
(poses of its sensor in that part's frame, its own coverage, seconds).

Its phase 2 numbers the candidates that see more than ten voxels and then names them from the list of all candidates,
so the poses that it saves are others than those that it chose. Here the chosen ones are taken. Its genetic algorithm is
left out, as in the peer's own list of the parameters that its samples were made with.
"""

import json
import os
import re
import sys
import time
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

MM = 1000.0


def candidates(checkout, mesh, metres_per_unit):
    """The names that phase 1 leaves behind. It draws without a seed; one is set here."""
    source = (checkout / "PHASE_1_Get_Can_VPs.py").read_text(encoding="utf-8")
    source = re.sub(r"^obj_mesh_path = .*$", f"obj_mesh_path = {str(mesh)!r}", source, flags=re.M)
    source = re.sub(r"^obj_mesh_scale = \S+", f"obj_mesh_scale = {metres_per_unit!r}", source, flags=re.M)
    Path("00_Output Collection").mkdir(exist_ok=True)
    np.random.seed(0)
    names = {"__name__": "phase_1"}
    exec(compile(source, "PHASE_1_Get_Can_VPs.py", "exec"), names)
    return names


def greedy(checkout, views):
    """Phase 2, greedy: the keys chosen and the number of voxels that they see."""
    sys.path.insert(0, str(checkout))
    os.environ.setdefault("MPLBACKEND", "agg")
    import SCP_src

    keys = [key for key, view in views.items() if len(view["visible Obj Voxel Indices"]) > 10]
    subsets = [set(views[key]["visible Obj Voxel Indices"]) for key in keys]
    universe = set().union(*subsets)
    chosen = SCP_src.greedySetCovering(universe, subsets)
    return [keys[index] for index in chosen], len(universe)


def poses(names, chosen):
    """part_from_scanner of the chosen views, mm: the scanner's frame lies in the front face of the sensor, which the
    peer mounts its length ahead of the point that it calls the viewpoint."""
    grid = names["obj_mesh"].voxelized(names["tm_voxelSize"], method="subdivide", max_iter=1000)
    pad = int(names["tm_rb_ma_maxRange"] * names["sampleSpace_extension"])
    views = names["dataCollection"]["VPs"]
    for key in chosen:
        rotation = np.array(views[key]["RotationMatrix"])
        index = np.array(views[key]["coord"], float) - pad
        mount = (grid.transform @ [*index, 1.0])[:3] * MM
        yield {
            "translation_mm": (mount + names["s_size_length"] * rotation[:, 2]).tolist(),
            "quaternion_xyzw": Rotation.from_matrix(rotation).as_quat().tolist(),
        }


def main(checkout, mesh, metres_per_unit, out):
    started = time.process_time()
    names = candidates(checkout, mesh, metres_per_unit)
    statistics = names["dataCollection"]["statistics"]
    chosen, seen = greedy(checkout, names["dataCollection"]["VPs"])
    cpu_secs = time.process_time() - started
    names["obj_mesh"].copy().apply_scale(MM).export(out / "part.stl")
    answer = {
        "candidates": statistics["init number_of_vp_candidates"],
        "voxels_seen": seen / statistics["Occupied Object Voxel Count"],
        "cpu_secs": cpu_secs,
        "poses": list(poses(names, chosen)),
    }
    (out / "peer.json").write_text(json.dumps(answer))


if __name__ == "__main__":
    out = Path(sys.argv[4]).resolve()
    paths = Path(sys.argv[1]).resolve(), Path(sys.argv[2]).resolve()
    out.mkdir(parents=True, exist_ok=True)
    os.chdir(out)
    main(*paths, float(sys.argv[3]), out)
