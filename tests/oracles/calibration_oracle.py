"""Hand-eye calibrations by OpenCV and, refined, by SciPy: one JSON object a line in, one out.

in:  {"frames": [[16 numbers]...], "seen": [[16 numbers]...], "setup": "eye_in_hand" | "eye_to_hand", "sigma": [4 numbers] or null}
     frames are base_from_flange (its inverse with eye_to_hand), seen is cloud_from_board; rows, mm. sigma: rad, mm, rad, mm.
out: {"park": [16], "daniilidis": [16], "refined": [16] or null}
"""

import json
import sys

import cv2
import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation


def solve(frames, seen, method):
    rotation, translation = cv2.calibrateHandEye(
        [f[:3, :3] for f in frames], [f[:3, 3] for f in frames], [s[:3, :3] for s in seen], [s[:3, 3] for s in seen], method=method
    )
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, translation.ravel()
    return pose


def hat(v):
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def adjoint(pose):
    out = np.zeros((6, 6))
    out[:3, :3] = out[3:, 3:] = pose[:3, :3]
    out[3:, :3] = hat(pose[:3, 3]) @ pose[:3, :3]
    return out


def left_jacobian(w):
    angle, h = np.linalg.norm(w), hat(w)
    if angle < 1e-5:
        return np.eye(3) + 0.5 * h + h @ h / 6
    return np.eye(3) + (1 - np.cos(angle)) / angle**2 * h + (angle - np.sin(angle)) / angle**3 * h @ h


def exp(x):
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_rotvec(x[:3]).as_matrix()
    pose[:3, 3] = left_jacobian(x[:3]) @ x[3:]
    return pose


def log(pose):
    w = Rotation.from_matrix(pose[:3, :3]).as_rotvec()
    return np.concatenate([w, np.linalg.solve(left_jacobian(w), pose[:3, 3])])


def refine(frames, seen, start, setup, sigma):
    x, y = start, frames[0] @ start @ seen[0]
    arm = np.diag([sigma[0] ** 2] * 3 + [sigma[1] ** 2] * 3)
    board = np.diag([sigma[2] ** 2] * 3 + [sigma[3] ** 2] * 3)
    for _ in range(12):
        whiteners = []
        for frame, each in zip(frames, seen):
            lever = x @ each if setup == "eye_in_hand" else frame @ x @ each
            jacobian = adjoint(np.linalg.inv(lever))
            covariance = jacobian @ arm @ jacobian.T + board
            whiteners.append(np.linalg.cholesky(np.linalg.inv(covariance)).T)

        def residuals(p):
            moved_x, moved_y = x @ exp(p[:6]), y @ exp(p[6:])
            inverse = np.linalg.inv(moved_x)
            terms = []
            for frame, each, whitener in zip(frames, seen, whiteners):
                terms.append(whitener @ log(np.linalg.inv(each) @ inverse @ np.linalg.inv(frame) @ moved_y))
            return np.concatenate(terms)

        scale = np.tile([1e-3] * 3 + [1.0] * 3, 2)
        found = least_squares(residuals, np.zeros(12), x_scale=scale, jac="3-point", xtol=1e-15, ftol=1e-15, gtol=1e-15)
        x, y = x @ exp(found.x[:6]), y @ exp(found.x[6:])
        if np.linalg.norm(found.x[3:6]) < 1e-11:
            break
    return x


for line in sys.stdin:
    asked = json.loads(line)
    frames = [np.array(f).reshape(4, 4) for f in asked["frames"]]
    seen = [np.array(s).reshape(4, 4) for s in asked["seen"]]
    park = solve(frames, seen, cv2.CALIB_HAND_EYE_PARK)
    answer = {"park": park.ravel().tolist(), "daniilidis": solve(frames, seen, cv2.CALIB_HAND_EYE_DANIILIDIS).ravel().tolist()}
    answer["refined"] = refine(frames, seen, park, asked["setup"], asked["sigma"]).ravel().tolist() if asked["sigma"] else None
    print(json.dumps(answer), flush=True)
