"""Forward kinematics by yourdfpy: usage urdf_fk.py FILE FRAME...; joint vectors (JSON lists, radians) a line on stdin,
for each a line on stdout with [x, y, z, i, j, k, w] of every frame in elfin_base_link, metres."""
import json
import sys

import numpy as np
import yourdfpy


def quaternion(r):
    """Largest component first, so that nothing is divided by something small."""
    k = np.array(
        [
            [r[0, 0] - r[1, 1] - r[2, 2], 0, 0, 0],
            [r[0, 1] + r[1, 0], r[1, 1] - r[0, 0] - r[2, 2], 0, 0],
            [r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], r[2, 2] - r[0, 0] - r[1, 1], 0],
            [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], r[0, 0] + r[1, 1] + r[2, 2]],
        ]
    )
    _, vectors = np.linalg.eigh(k, UPLO="L")
    return vectors[:, -1]


urdf = yourdfpy.URDF.load(sys.argv[1], load_meshes=False, build_scene_graph=True)
for line in sys.stdin:
    urdf.update_cfg(np.array(json.loads(line)))
    poses = []
    for frame in sys.argv[2:]:
        m = urdf.get_transform(frame, "elfin_base_link")
        poses.append([float(v) for v in (*m[:3, 3], *quaternion(m[:3, :3]))])
    print(json.dumps(poses))
