#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Calibrates every real image set by one command each and writes docs/accuracy.md.

    ./dev bench accuracy            all sets, into docs/accuracy.md
    bench/accuracy/run.py NAME...   only these, printed

Needs PLUMBLINE_DATA and build/plumbline; with python3-opencv OpenCV solves the same corners as referee.
"""
import glob
import json
import os
import re
import subprocess
import sys
import tempfile

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import corner_lists  # noqa: E402
from sets import NOT_CALIBRATED, SETS  # noqa: E402

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
PLUMBLINE = os.path.join(ROOT, "build", "plumbline")


def gathered(folder, name, patterns, data):
    """A pattern for the files of several patterns: links in one folder."""
    where = os.path.join(folder, name)
    os.makedirs(where)
    files = [f for p in patterns for f in sorted(glob.glob(os.path.join(data, p)))]
    for file in files:
        os.symlink(file, os.path.join(where, os.path.basename(file)))
    return os.path.join(where, "*" + os.path.splitext(files[0])[1]) if files else None


def image_size(file):
    import cv2
    image = cv2.imread(file, cv2.IMREAD_GRAYSCALE)
    return "{}x{}".format(image.shape[1], image.shape[0])


def camera_arguments(spec, data, work):
    arguments = []
    for name, patterns in spec["cams"].items():
        if "corners" in spec:
            pattern = patterns
        elif isinstance(patterns, list):
            pattern = gathered(work, name, patterns, data)
            if "same_size" in spec:
                for file in glob.glob(pattern):
                    if image_size(file) != spec["same_size"]:
                        os.unlink(file)
        else:
            pattern = os.path.join(data, patterns)
        arguments += ["--cam", f"{name}={pattern}"]
    return arguments


def calibrate(spec, data, work, more):
    board = os.path.join(work, "board.yaml")
    if not os.path.exists(board):
        subprocess.run([PLUMBLINE, "target", "new", *spec["target"], "-o", board], check=True, capture_output=True)
    command = [PLUMBLINE, "calibrate", "--target", board, "--lens", spec["lens"], "--json", *more]
    if "corners" in spec:
        corners = os.path.join(work, "corners.vnl")
        getattr(corner_lists, spec["corners"])(data, spec, corners)
        command += ["--corners", corners, "--image-size", spec["image_size"]]
    run = subprocess.run(command + camera_arguments(spec, data, work), capture_output=True, text=True)
    if run.returncode != 0:
        return {"error": run.stderr.strip().splitlines()[-1]}
    return json.loads(run.stdout)


def read_corners(folder):
    """corners.yaml, far enough for a referee: points of the target by OpenCV's own reading are not needed, because
    calibration.yaml's residuals are not read here; only which point was seen where."""
    views, view = [], None
    for line in open(os.path.join(folder, "corners.yaml")):
        camera = re.match(r"\s+- camera: (\S+)", line)
        if camera:
            view = (camera.group(1).strip('"'), [])
            views.append(view)
            continue
        row = re.match(r"\s+(\d+) (\S+) (\S+) \S+$", line)
        if row and view:
            view[1].append((int(row.group(1)), float(row.group(2)), float(row.group(3))))
    return views


def board_points(spec):
    """The target's points, derived here again from its arguments."""
    arguments = dict(zip(spec["target"][::2], spec["target"][1::2]))
    kind = arguments["--type"]
    if kind == "aprilgrid":
        columns, rows = map(int, arguments["--tags"].split("x"))
        size, pitch = float(arguments["--tag-size"]), float(arguments["--tag-size"]) * (1 + float(arguments["--tag-spacing"]))
        return [(c * pitch + dx * size, r * pitch + dy * size, 0.0) for r in range(rows) for c in range(columns)
                for dx, dy in ((0, 0), (1, 0), (1, 1), (0, 1))]
    count = arguments.get("--corners") or arguments.get("--circles") or arguments["--squares"]
    columns, rows = map(int, count.split("x"))
    if kind == "charuco":
        columns, rows = columns - 1, rows - 1
    step = float(arguments.get("--square") or arguments["--spacing"])
    return [(c * step, r * step, 0.0) for r in range(rows) for c in range(columns)]


def opencv_referee(spec, folder, cameras):
    """OpenCV's rms and fx for each camera alone, on the very corners that Plumbline used (outliers off)."""
    try:
        import cv2
        import numpy
    except ImportError:
        return None
    points, answers = board_points(spec), []
    for camera in cameras:
        object_points, image_points = [], []
        for name, corners in read_corners(folder):
            if name == camera["name"] and len(corners) >= 4:
                object_points.append(numpy.array([points[p] for p, _, _ in corners], numpy.float32))
                image_points.append(numpy.array([(x, y) for _, x, y in corners], numpy.float32))
        size = (camera["width"], camera["height"])
        tight = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 300, 1e-14)
        try:
            if spec["lens"] == "kb4":
                rms, K, *_ = cv2.fisheye.calibrate([o.reshape(1, -1, 3).astype(float) for o in object_points],
                                                   [i.reshape(1, -1, 2).astype(float) for i in image_points], size,
                                                   numpy.eye(3), numpy.zeros(4),
                                                   flags=cv2.fisheye.CALIB_RECOMPUTE_EXTRINSIC + cv2.fisheye.CALIB_FIX_SKEW,
                                                   criteria=tight)
            else:
                flags = {"opencv4": cv2.CALIB_FIX_K3, "opencv5": 0, "opencv8": cv2.CALIB_RATIONAL_MODEL}[spec["lens"]]
                flags += cv2.CALIB_USE_LU if len(object_points) > 40 else 0
                rms, K, *_ = cv2.calibrateCamera(object_points, image_points, size, None, None, flags=flags, criteria=tight)
            answers.append((rms, K[0, 0]))
        except cv2.error as error:
            answers.append((None, str(error).split("error:")[-1].strip().splitlines()[0][:60]))
    return answers


def numbers(values, digits):
    return ", ".join(f"{v:.{digits}f}" for v in values)


def row_of(spec, data):
    with tempfile.TemporaryDirectory() as work:
        result = calibrate(spec, data, work, ["-o", os.path.join(work, "out")])
        if "error" in result:
            return [spec["name"], spec["lens"], "", "", "", "", "", "", result["error"]]
        referee, n_off = None, None
        for folder in glob.glob(os.path.join(work, "*", "")):  # links of the first run
            if not os.path.exists(os.path.join(folder, "calibration.yaml")):
                subprocess.run(["rm", "-r", folder], check=True)
        if len(result["cameras"]) >= 1 and sum(v["corners"] for v in result["views"]) < 40000:
            rms_alone = []
            for camera in result["cameras"]:
                one = dict(spec, cams={camera["name"]: spec["cams"][camera["name"]]})
                folder = os.path.join(work, "off_" + camera["name"])
                off = calibrate(one, data, work, ["--outliers", "off", "-o", folder])
                for links in glob.glob(os.path.join(work, camera["name"], "")):
                    subprocess.run(["rm", "-r", links], check=True)
                if "error" in off:
                    rms_alone = None
                    break
                answer = opencv_referee(spec, folder, off["cameras"])
                rms_alone.append((off["rms_px"], off["cameras"][0]["params"]["fx"], *(answer[0] if answer else (None, None))))
            referee = rms_alone
        used = sum(v["used"] for v in result["views"])
        found = sum(v["corners"] > 0 for v in result["views"])
        known = spec.get("known")
        remarks = [spec["remark"]] if "remark" in spec else []
        if result["weak"]:
            remarks.append("WEAK: " + result["weak"][0]["parameters"].split("(")[0].strip())
        if spec.get("expect_weak") and not result["weak"]:
            remarks.append("NOT FLAGGED AS WEAK")
        same = ""
        if referee:
            same = "; ".join("{:.4f} / {}".format(a, f"{b:.4f}" if b is not None else "-") for a, _, b, _ in referee)
            same += "<br>" + "; ".join("{:.2f} / {}".format(a, f"{b:.2f}" if isinstance(b, float) else b or "-")
                                       for _, a, _, b in referee)
        return [spec["name"], spec["lens"], f"{found}/{len(result['views'])}, {used} used", str(result["corners"]),
                str(result["outliers"]), f"{result['rms_px']:.4f}",
                numbers([c["params"]["fx"] for c in result["cameras"]], 2),
                "{} {}".format(numbers(known["fx"], 2), f"(rms {known['rms']})" if known["rms"] else "") if known else "none",
                same, "; ".join(([known["by"]] if known else []) + remarks)]


HEAD = ["set", "lens", "boards found / images", "corners", "outliers", "rms [px]", "fx [px]", "published fx",
        "each camera alone, no outliers marked: rms, fx; Plumbline / OpenCV on the same corners", "who published; remarks"]


def main():
    data = os.environ.get("PLUMBLINE_DATA") or os.path.join(ROOT, "..", "shared", "data")
    if not os.path.isdir(data):
        sys.exit("PLUMBLINE_DATA names no folder with the data sets")
    wanted = sys.argv[1:]
    rows = []
    for spec in SETS:
        if wanted and spec["name"] not in wanted:
            continue
        row = row_of(spec, os.path.abspath(data))
        row += [""] * (len(HEAD) - len(row))
        rows.append(row)
        print(" | ".join(row), file=sys.stderr, flush=True)
    table = "\n".join(["| " + " | ".join(HEAD) + " |", "|" + "---|" * len(HEAD)] + ["| " + " | ".join(r) + " |" for r in rows])
    if wanted:
        print(table)
        return
    commit = subprocess.run(["git", "-C", ROOT, "rev-parse", "--short", "HEAD"], capture_output=True, text=True).stdout.strip()
    others = "\n".join(f"| {name} | {reason} |" for name, reason in NOT_CALIBRATED)
    path = os.path.join(ROOT, "docs", "accuracy.md")
    marker = "<!-- table: ./dev bench accuracy -->"
    text = open(path).read().split(marker)
    text[1] = (f"\n\nMade by `./dev bench accuracy` at commit {commit}, seed 0.\n\n{table}\n\n"
               f"Sets that have nothing to calibrate:\n\n| set | why |\n|---|---|\n{others}\n\n")
    open(path, "w").write(marker.join(text))


if __name__ == "__main__":
    main()
