# SPDX-License-Identifier: Apache-2.0
"""Corner lists of other projects, written as mrcal's corners.vnl, which plumbline reads."""
import ast
import base64
import csv
import glob
import io
import os


def write_vnl(path, images):
    """images: [(name, {point: (x, y)}, n_points)]; points that are not there get the level '-'."""
    with open(path, "w") as out:
        out.write("# filename x y level\n")
        for name, corners, n_points in images:
            if not corners:
                out.write(f"{name} - - -\n")
                continue
            for point in range(n_points):
                if point in corners:
                    out.write("{} {!r} {!r} 0\n".format(name, *map(float, corners[point])))
                else:
                    out.write(f"{name} 0 0 -\n")


def _yac(folder, out, frames):
    """yac's CSV of an AprilGrid: tag_id * 4 + corner is our numbering too (Kalibr's)."""
    images = []
    for cam in ("cam0", "cam1"):
        for file in sorted(glob.glob(os.path.join(folder, cam, "*.csv")))[frames]:
            corners = {}
            for row in csv.reader(open(file)):
                if row and not row[0].startswith("#"):
                    corners[int(row[10]) * 4 + int(row[11])] = (row[5], row[6])
            images.append((f"{cam}/{os.path.basename(file)}", corners, 144))
    write_vnl(out, images)


def yac_frames(root, spec, out):
    _yac(os.path.join(root, spec["folder"]), out, slice(None))


def yac_half_second(root, spec, out):
    _yac(os.path.join(root, spec["folder"]), out, slice(260, 270))


def vnl(root, spec, out):
    with open(os.path.join(root, spec["file"])) as text, open(out, "w") as copy:
        copy.write(text.read())


def cameramodel(root, spec, out):
    """The board observations that mrcal keeps inside a .cameramodel (needs numpy). Weight <= 0: not used."""
    import numpy
    text = open(os.path.join(root, spec["file"])).read()
    body = "\n".join(line for line in text.splitlines() if not line.lstrip().startswith("#"))
    model = ast.literal_eval(body.strip())
    inputs = numpy.load(io.BytesIO(base64.b85decode(model["optimization_inputs"])))
    images = []
    for i, board in enumerate(inputs["observations_board"]):
        flat = board.reshape(-1, 3)
        corners = {j: (x, y) for j, (x, y, weight) in enumerate(flat) if weight > 0}
        images.append((f"view{i:04d}", corners, len(flat)))
    write_vnl(out, images)


def orpc(root, spec, out):
    """BabelCalib's published corners: board, point, 1, x, y. The points are those of the .dsc file in its order: 22 x 22
    inner corners row by row from the top left, which is our numbering too."""
    images = []
    for file in sorted(glob.glob(os.path.join(root, spec["folder"], "*.orpc"))):
        corners = {}
        for line in open(file):
            piece = line.strip().split(",")
            if len(piece) == 5:
                corners[int(piece[1])] = (piece[3], piece[4])
        images.append((os.path.basename(file)[:-5], corners, 22 * 22))
    write_vnl(out, images)


def opencv_dat(root, spec, out):
    """OpenCV's calib1.dat: image size, columns and rows, number of views, two flags, then the object points and the image
    points of all views, then remarks in words."""
    numbers = []
    for word in open(os.path.join(root, spec["file"])).read().split():
        try:
            numbers.append(float(word))
        except ValueError:
            break
    columns, rows, views = (int(v) for v in numbers[2:5])
    n = columns * rows
    object_points = numbers[7:7 + 3 * n * views]
    image_points = numbers[7 + 3 * n * views:7 + 5 * n * views]
    square = object_points[3]
    images = []
    for i in range(views):
        corners = {}
        for j in range(n):
            x, y = object_points[3 * (n * i + j)], object_points[3 * (n * i + j) + 1]
            corners[round(y / square) * columns + round(x / square)] = image_points[2 * (n * i + j):2 * (n * i + j) + 2]
        images.append((f"view{i}", corners, n))
    write_vnl(out, images)
