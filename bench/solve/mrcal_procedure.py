#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""mrcal_procedure.py CORNERS LENSMODEL: the stages of mrcal-calibrate-cameras on the corners that `solve_bench write`
wrote: seed, poses, poses and core, everything with regularisation and outlier rejection. One JSON line."""
import json
import resource
import sys

import mrcal
import numpy as np

WIDTH, HEIGHT, COLUMNS, ROWS, SPACING_M = 1920, 1200, 10, 14, 0.03


def cpu_s():
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def main():
    rows = [line.split() for line in open(sys.argv[1])]
    model = sys.argv[2]
    at = np.array([[int(r[1]), int(r[0])] for r in rows], dtype=np.int32)  # frame, camera
    order = np.lexsort((at[:, 1], at[:, 0]))
    at = at[order]
    n_cams = at[:, 1].max() + 1
    corners = np.ones((len(rows), ROWS, COLUMNS, 3))
    corners[..., :2] = np.array([r[2:] for r in rows], dtype=float)[order].reshape(-1, ROWS, COLUMNS, 2)
    indices = np.ascontiguousarray(np.column_stack([at, at[:, 1] - 1]).astype(np.int32))
    sizes = np.tile(np.array([WIDTH, HEIGHT], dtype=np.int32), (n_cams, 1))
    start = cpu_s()
    core, T_cam_ref, T_ref_board = mrcal.seed_stereographic(
        imagersizes=sizes, focal_estimate=1300.0, indices_frame_camera=at, observations=corners, object_spacing=SPACING_M)
    if T_cam_ref.ndim == 3:
        T_cam_ref = mrcal.rt_from_Rt(T_cam_ref)
    problem = dict(
        intrinsics=core, extrinsics_rt_fromref=np.ascontiguousarray(T_cam_ref), frames_rt_toref=T_ref_board, points=None,
        observations_board=corners, indices_frame_camintrinsics_camextrinsics=indices, observations_point=None,
        indices_point_camintrinsics_camextrinsics=None, imagersizes=sizes, calibration_object_spacing=SPACING_M,
        lensmodel="LENSMODEL_STEREOGRAPHIC", do_optimize_intrinsics_distortions=False, do_optimize_calobject_warp=False,
        do_apply_outlier_rejection=False, do_apply_regularization=False, verbose=False)
    mrcal.optimize(**dict(problem, do_optimize_intrinsics_core=False))
    mrcal.optimize(**dict(problem, do_optimize_intrinsics_core=True))
    n_more = mrcal.lensmodel_num_params(model) - 4
    small = (np.random.default_rng(0).random((n_cams, n_more)) - 0.5) * 2e-6
    problem.update(
        intrinsics=np.ascontiguousarray(np.concatenate([problem["intrinsics"], small], 1)), lensmodel=model,
        do_optimize_intrinsics_core="SPLINED" not in model, do_optimize_intrinsics_distortions=True,
        do_apply_outlier_rejection=True, do_apply_regularization=True)
    stats = mrcal.optimize(**problem)
    x = stats["x"][:2 * ROWS * COLUMNS * len(rows)]
    print(json.dumps({"tool": "mrcal-procedure", "cpu_ms": 1e3 * (cpu_s() - start), "rms_xy_px": float(np.sqrt(np.mean(x * x))),
                      "iterations": 0, "error_px": float("nan"), "mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
                      "parameters": problem["intrinsics"][0].tolist()}))


if __name__ == "__main__":
    main()
