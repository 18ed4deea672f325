#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""mrcal_trials.py FOLDER: on each trial that `seeds_bench ... FOLDER` wrote, the stages of mrcal-calibrate-cameras with the
TRUE focal length given, without outlier rejection and, at the end, without regularisation, so that its optimum is the same
one. One JSON line: how many reached a cost within 1e-4 of the best."""
import json
import os
import sys

import mrcal
import numpy as np

COLUMNS, ROWS, SPACING_M = 9, 6, 0.025
SIZE = np.array([[1280, 960]], dtype=np.int32)
MODEL = "LENSMODEL_OPENCV5"


def read(path):
    lines = [line.split() for line in open(path)]
    focal, best = map(float, lines[0])
    frames = sorted({int(line[0]) for line in lines[1:]})
    corners = np.zeros((len(frames), ROWS * COLUMNS, 3))
    corners[..., 2] = -1
    for frame, point, u, v in lines[1:]:
        corners[frames.index(int(frame)), int(point)] = float(u), float(v), 1
    return focal, best, corners.reshape(-1, ROWS, COLUMNS, 3)


def cost(corners, focal):
    n = len(corners)
    at = np.column_stack([np.arange(n), np.zeros(n)]).astype(np.int32)
    core, _, T_ref_board = mrcal.seed_stereographic(imagersizes=SIZE, focal_estimate=focal, indices_frame_camera=at,
                                                    observations=corners, object_spacing=SPACING_M)
    problem = dict(
        intrinsics=core, extrinsics_rt_fromref=np.zeros((0, 6)), frames_rt_toref=T_ref_board, points=None,
        observations_board=corners, indices_frame_camintrinsics_camextrinsics=np.ascontiguousarray(
            np.column_stack([at, -np.ones(n)]).astype(np.int32)),
        observations_point=None, indices_point_camintrinsics_camextrinsics=None, imagersizes=SIZE,
        calibration_object_spacing=SPACING_M, lensmodel="LENSMODEL_STEREOGRAPHIC", do_optimize_intrinsics_distortions=False,
        do_optimize_extrinsics=False, do_optimize_calobject_warp=False, do_apply_outlier_rejection=False,
        do_apply_regularization=False, verbose=False)
    mrcal.optimize(**dict(problem, do_optimize_intrinsics_core=False))
    mrcal.optimize(**dict(problem, do_optimize_intrinsics_core=True))
    small = (np.random.default_rng(0).random((1, mrcal.lensmodel_num_params(MODEL) - 4)) - 0.5) * 2e-6
    problem.update(intrinsics=np.ascontiguousarray(np.concatenate([problem["intrinsics"], small], 1)), lensmodel=MODEL,
                   do_optimize_intrinsics_core=True, do_optimize_intrinsics_distortions=True)
    mrcal.optimize(**dict(problem, do_apply_regularization=True))
    x = mrcal.optimize(**problem)["x"][:2 * ROWS * COLUMNS * n]
    return float(np.sum(x * x))


def main():
    tally = {"reached": 0, "elsewhere": 0, "threw": 0}
    for name in sorted(os.listdir(sys.argv[1])):
        focal, best, corners = read(os.path.join(sys.argv[1], name))
        try:
            ratio = cost(corners, focal) / best
            tally["reached" if ratio <= 1 + 1e-4 else "elsewhere"] += 1
            print(f"{name}: {ratio:.6g} times the best cost", file=sys.stderr)
        except Exception:  # whatever mrcal raises is its answer
            tally["threw"] += 1
    print(json.dumps(tally))


if __name__ == "__main__":
    main()
