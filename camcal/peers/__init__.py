"""The functions of cv2 with which camcal is compared, one file each.

`CALIBRATORS` says which file runs which calibration function of cv2; a model names its function in
`Lens.opencv`. Adding one = a file that offers `run(task, guess)` and a line here.
"""

CALIBRATORS = {
    "calibrateCamera": "camcal.peers.calibrate_camera:run",
    "fisheye.calibrate": "camcal.peers.fisheye_calibrate:run",
    "omnidir.calibrate": "camcal.peers.omnidir_calibrate:run",
}

#: those that know skew
WITH_SKEW = ("fisheye.calibrate", "omnidir.calibrate")
