"""Lenses by OpenCV: projections, files, and a stereo calibration from pictures.

lens_oracle.py project          stdin: JSON {matrix, distortion, points}; stdout: a line "u v" a point (cv2.projectPoints)
lens_oracle.py files FOLDER     stdin: JSON {M1, D1, M2, D2, R, T, size}; writes rig.yml, rig.xml and rig.json (cv2.FileStorage)
lens_oracle.py stereo FOLDER    stdout: one line of JSON with the corners of the chessboard in every pair, and OpenCV's residuals
"""

import json
import pathlib
import sys

import cv2
import numpy as np

COLUMNS, ROWS, SQUARE_MM = 9, 6, 25.0
CRITERIA = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 100, 1e-9)


def project():
    given = json.load(sys.stdin)
    points = np.array(given["points"], dtype=np.float64).reshape(-1, 1, 3)
    matrix, distortion = np.array(given["matrix"], dtype=np.float64), np.array(given["distortion"], dtype=np.float64)
    pixels, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), matrix, distortion)
    for u, v in pixels.reshape(-1, 2):
        print(f"{u:.17g} {v:.17g}")


def files(folder):
    given = json.load(sys.stdin)
    for ending in ("yml", "xml", "json"):
        storage = cv2.FileStorage(str(pathlib.Path(folder) / f"rig.{ending}"), cv2.FILE_STORAGE_WRITE)
        for name in ("M1", "D1", "M2", "D2", "R", "T"):
            storage.write(name, np.array(given[name], dtype=np.float64))
        storage.write("image_width", int(given["size"][0]))
        storage.write("image_height", int(given["size"][1]))
        storage.release()


def corners(picture):
    image = cv2.imread(str(picture), cv2.IMREAD_GRAYSCALE)
    found, points = cv2.findChessboardCorners(image, (COLUMNS, ROWS))
    if not found:
        sys.exit(f"{picture}: no chessboard")
    # A window of 11 pixels: squares are about 30 wide, and less where the board is tilted.
    return cv2.cornerSubPix(image, points, (5, 5), (-1, -1), (3, 100, 1e-4)), image.shape[::-1]


def rms(board, seen, matrix, distortion, poses):
    """Root mean square length over all points, for poses (rotation vector, translation) of the boards."""
    squares = []
    for pixels, (turn, shift) in zip(seen, poses):
        computed, _ = cv2.projectPoints(board, turn, shift, matrix, distortion)
        squares.append(((computed - pixels).reshape(-1, 2) ** 2).sum(axis=1))
    return float(np.sqrt(np.concatenate(squares).mean()))


def stereo(folder):
    board = np.zeros((COLUMNS * ROWS, 3), np.float32)
    board[:, :2] = np.mgrid[0:COLUMNS, 0:ROWS].T.reshape(-1, 2) * SQUARE_MM
    names = sorted(path.stem[4:] for path in pathlib.Path(folder).glob("left[0-9][0-9].jpg"))
    pairs = [[corners(pathlib.Path(folder) / f"{side}{name}.jpg") for side in ("left", "right")] for name in names]
    size = pairs[0][0][1]
    left, right = [pair[0][0] for pair in pairs], [pair[1][0] for pair in pairs]
    boards = [board] * len(names)
    _, m1, d1, _, _ = cv2.calibrateCamera(boards, left, size, None, None, criteria=CRITERIA)
    _, m2, d2, _, _ = cv2.calibrateCamera(boards, right, size, None, None, criteria=CRITERIA)
    both, m1, d1, m2, d2, turn, shift, _, _, turns, shifts, _ = cv2.stereoCalibrateExtended(
        boards, left, right, m1, d1, m2, d2, size, np.eye(3), np.zeros((3, 1)),
        flags=cv2.CALIB_USE_INTRINSIC_GUESS, criteria=CRITERIA,
    )
    from_left = list(zip(turns, shifts))
    from_right = [(cv2.Rodrigues(turn @ cv2.Rodrigues(r)[0])[0], turn @ t + shift) for r, t in from_left]
    print(json.dumps({
        "size": size,
        "names": names,
        "left": [pixels.reshape(-1, 2).tolist() for pixels in left],
        "right": [pixels.reshape(-1, 2).tolist() for pixels in right],
        "rms_px": both,
        "left_rms_px": rms(board, left, m1, d1, from_left),
        "right_rms_px": rms(board, right, m2, d2, from_right),
        "baseline_mm": float(np.linalg.norm(shift)),
    }))


if __name__ == "__main__":
    cv2.setNumThreads(1)
    {"project": project, "files": files, "stereo": stereo}[sys.argv[1]](*sys.argv[2:])
