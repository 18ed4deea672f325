# SPDX-License-Identifier: Apache-2.0
"""The real image sets of the accuracy table: what to run, and what is known of each answer.

A set is found under PLUMBLINE_DATA. `cams` maps a camera to a file pattern, or to a list of patterns whose files are
gathered in one folder. `corners` names a function of corner_lists.py instead of images. `known` is the answer that the
set's authors or another tool published for it: fx per camera [px], the rms where one is given, and who says so.
"""

CHESS = "chessboard"


def chess(corners, square):
    return ["--type", CHESS, "--corners", corners, "--square", str(square)]


def charuco(squares, square, marker, dictionary):
    return ["--type", "charuco", "--squares", squares, "--square", str(square), "--marker", str(marker), "--dict",
            dictionary]


def aprilgrid(tags="6x6", size=0.088, spacing=0.3):
    return ["--type", "aprilgrid", "--tags", tags, "--tag-size", str(size), "--tag-spacing", str(spacing)]


def circles(count, spacing):
    return ["--type", "circles", "--circles", count, "--spacing", str(spacing)]


FISHEYE = "opencv_extra/cameracalibration/fisheye/calib-3_stereo_from_JY"
BOOF = "boofcv_calibration"
LIFECAM = "photonvision/calibrationCharucoImg/lifecam"

SETS = [
    dict(name="opencv_leftright", target=chess("9x6", 0.025), lens="opencv5",
         cams={"left": "opencv_leftright/left*.jpg", "right": "opencv_leftright/right*.jpg"},
         known=dict(fx=[533.417, 537.022], rms=0.2151, by="OpenCV stereoCalibrate, all free; squares of 25 mm")),
    dict(name="opencv_fisheye_stereo", target=chess("8x6", 0.0244), lens="kb4",
         cams={"left": f"{FISHEYE}/left/*.jpg", "right": f"{FISHEYE}/right/*.jpg"},
         known=dict(fx=[561.196, 560.395], rms=0.3271, by="OpenCV test_fisheye.cpp, on its own corners")),
    dict(name="boof_bumblebee2", target=chess("4x6", 0.030), lens="opencv5",
         cams={"left": f"{BOOF}/stereo/Bumblebee2_Chess/left*.jpg", "right": f"{BOOF}/stereo/Bumblebee2_Chess/right*.jpg"},
         known=dict(fx=[524.614, 526.437], rms=None, by="BoofCV stereo.yaml (two radial terms), baseline 120.05 mm")),
    dict(name="boof_trinocular", target=chess("13x9", 1.0), lens="opencv5",
         cams={c: f"{BOOF}/trinocular/{c}/{c}*.jpg" for c in ("left", "middle", "right")},
         known=dict(fx=[1837.85, 1842.34, 1837.98], rms=None, by="OpenCV, each camera alone, 30 frames (15 here)")),
    dict(name="boof_fisheye", target=chess("4x6", 1.0), lens="kb4", cams={"cam": f"{BOOF}/fisheye/chessboard/*.jpg"},
         known=dict(fx=[190.15], rms=0.1995, by="OpenCV fisheye, 24 of 26 views")),
    dict(name="boof_sony_chess", target=chess("4x6", 0.030), lens="opencv5",
         cams={"cam": f"{BOOF}/mono/Sony_DSC-HX5V_Chess/frame*.jpg"},
         known=dict(fx=[707.13], rms=0.1567, by="OpenCV; BoofCV says 701.01 with two radial terms")),
    dict(name="boof_sony_circles", target=circles("10x8", 0.025), lens="opencv4",
         cams={"cam": f"{BOOF}/mono/Sony_DSC-HX5V_CircleRegular/image*.jpg"},
         known=None, remark="six views; no published answer"),
    dict(name="euroc_imu_april", target=aprilgrid(), lens="opencv5", corners="yac_frames", image_size="752x480",
         folder="yac_euroc_april/imu_april", cams={"cam0": "cam0/*", "cam1": "cam1/*"},
         known=dict(fx=[458.654, 457.587], rms=None, by="EuRoC's Kalibr (two radial terms), baseline 0.11008 m")),
    dict(name="euroc_half_second", target=aprilgrid(), lens="opencv5", corners="yac_half_second", image_size="752x480",
         folder="yac_euroc_april/sequence", cams={"cam0": "cam0/*"}, expect_weak=True,
         known=dict(fx=[458.654], rms=None, by="EuRoC's Kalibr"),
         remark="ten frames, half a second, in place of cam_april, whose corner lists are not in this copy: must be called weak"),
    dict(name="tum_vi", target=aprilgrid(), lens="kb4",
         cams={"cam": ["aprilgrid_rs/tests/data/TUM_VI.png", "aprilgrid_rs/tests/data/r45.png",
                       "aprilgrid_rs/tests/data/right.png", "aprilgrid_rs/tests/data/top.png",
                       "aprilgrid_rs/data/1520525725372653511.png"]},
         known=dict(fx=[381.957], rms=None, by="TUM-VI's Kalibr, scaled to 1024 px")),
    dict(name="yizhong_charuco", target=charuco("9x7", 0.04, 0.02, "4X4_100"), lens="opencv5",
         cams={"cam": "yizhong_toolkit/intrinsic_calib_charuco_test_images/*.jpg"},
         known=dict(fx=[790.72], rms=0.330, by="OpenCV")),
    dict(name="photonvision_charuco_1280", target=charuco("8x8", 0.0254, 0.01905, "4X4_50"), lens="opencv5",
         cams={"cam": f"{LIFECAM}/2024-05-07_lifecam_1280/*.jpg"},
         known=dict(fx=[1128.32], rms=0.255, by="OpenCV")),
    dict(name="photonvision_charuco_480", target=charuco("8x8", 0.0254, 0.01905, "4X4_50"), lens="opencv5",
         cams={"cam": f"{LIFECAM}/2024-05-07_lifecam_480/*.jpg"},
         known=dict(fx=[679.84], rms=0.245, by="OpenCV")),
    dict(name="photonvision_chess_1280", target=chess("10x10", 0.0254), lens="opencv5",
         cams={"cam": "photonvision/calibrationSquaresImg/lifecam/2024-01-02_lifecam_1280/img*.png"},
         known=dict(fx=[1125.48], rms=0.9146, by="OpenCV; board on a monitor, fourfold ambiguity")),
    dict(name="picam_640", target=chess("7x7", 0.0254), lens="opencv5",
         cams={"cam": "photonvision/calibrationSquaresImg/piCam/640_480_1/img*.jpg"},
         known=dict(fx=[647.81], rms=0.606, by="OpenCV; board not flat")),
    dict(name="lifecam_vnl", target=chess("10x10", 0.0254), lens="opencv8", corners="vnl",
         file="wpical/lifecam_1280p_10x10.vnl", image_size="1280x720", cams={"cam": "*"},
         known=dict(fx=[1130.893], rms=0.382, by="mrcal 2.2 with its outlier rejection and board warp")),
    dict(name="wpical_charuco", target=charuco("12x8", 0.015586, 0.012123, "5X5_1000"), lens="opencv5",
         cams={"cam": "wpical_frames/charuco_1920x1080/frame*.jpg"},
         known=dict(fx=[1753.20], rms=0.545, by="OpenCV on 21 frames; 5 of them here")),
    dict(name="mrcal_c920", target=chess("10x10", 0.0254), lens="opencv8", corners="cameramodel",
         file="mrcal_java_cameramodel/camera-0.cameramodel", image_size="1600x896", cams={"cam": "*"},
         known=dict(fx=[1190.609], rms=None, by="mrcal with outlier rejection and board warp")),
    dict(name="mrcal_overpass", target=chess("10x10", 0.077), lens="opencv8", corners="cameramodel",
         file="mrcal_data/doc/data/figueroa-overpass-looking-S/splined-0.cameramodel", image_size="6016x4016", cams={"cam": "*"},
         known=dict(fx=[2073.873], rms=None, by="mrcal on the same 186 views, with outlier rejection and board warp")),
    dict(name="camodocal", target=chess("9x6", 1.0), lens="kb4", cams={"cam": "camodocal/img*.png"},
         known=dict(fx=[383.57], rms=0.486, by="OpenCV fisheye, 60 of 63 views (13 here)")),
    dict(name="stereopi", target=chess("9x6", 1.0), lens="kb4",
         cams={"left": "stereopi_fisheye/pairs/left_*.png", "right": "stereopi_fisheye/pairs/right_*.png"},
         known=dict(fx=[335.51, 335.42], rms=0.1189, by="OpenCV fisheye, 49 pairs (13 here)")),
    dict(name="vins", target=chess("12x8", 0.080), lens="opencv5", cams={"cam": "vins_camera_models/calibrationdata/*.png"},
         known=dict(fx=[469.26], rms=0.0728, by="OpenCV, 85 views (15 here)")),
    dict(name="udacity", target=chess("9x6", 1.0), lens="opencv5", same_size="1280x720",
         cams={"cam": ["udacity_camera_cal/calibration*.jpg"]},
         known=dict(fx=[1163.25], rms=0.916, by="OpenCV, 16 views (10 images here, one of another size)")),
    dict(name="pyocamcalib_fish1", target=chess("8x6", 1.0), lens="kb4", cams={"cam": "pyocamcalib/fish_1/*.jpg"},
         known=dict(fx=[336.86], rms=0.6436, by="OpenCV fisheye")),
    dict(name="caliscope", target=charuco("4x5", 0.054, 0.0405, "4X4_1000"), lens="opencv5",
         cams={f"cam_{i}": f"caliscope_frames/post_optimization/cam_{i}/frame*.jpg" for i in range(4)},
         known=dict(fx=[903.55, 760.33, 650.80, 639.88], rms=None, by="Caliscope's bundle on whole videos"),
         remark="12 corners, clustered poses: each camera alone is poorly determined"),
    dict(name="babelcalib_ov_plane", target=chess("22x22", 0.0075), lens="kb4", corners="orpc",
         folder="babelcalib_ov/ov_plane/corners/train", image_size="1280x800", cams={"cam": "*"},
         known=None, remark="published corner detections, 8 views here; no published parameters"),
    dict(name="bouguet_calib1", target=chess("7x5", 0.0254), lens="opencv4", corners="opencv_dat",
         file="opencv_extra/cameracalibration/calib1.dat", image_size="640x480", cams={"cam": "*"},
         known=dict(fx=[809.948], rms=0.139, by="Bouguet's toolbox (err 0.10179, 0.09492 px)")),
]

# Sets that have nothing to calibrate, with the reason: they stand in the table too.
NOT_CALIBRATED = [
    ("opencv_extra circles, asymmetric_circles", "detection only: truth for circle centres, several cameras, few views each"),
    ("opencv_extra subpixel, chess*, negative_*", "detection only: single images of unlike cameras"),
    ("opencv_extra omnidir", "catadioptric camera; none of today's lenses describes it"),
    ("boofcv circle_hexagonal, square_grid", "targets that are not supported (hexagonal circles, square grids)"),
    ("boofcv_stereo", "scenes without a board, for rectification"),
    ("photonvision_1280x720", "detection only: hard images of a board on a monitor, seven of them"),
    ("aprilgrid_py", "detection only: phone with autofocus, the camera changes between shots"),
    ("yac_euroc_april/cam_april", "its corner lists are not in this copy; euroc_half_second stands for it"),
    ("libcbdetect, apriltag_test", "detection only: several boards or loose tags in one image"),
    ("slambook2", "no board: rectified sequences"),
]
