"""cv2.registerCameras, cv2.fisheye.stereoCalibrate and cv2.calibrateMultiview on a rig.

Where cv2.stereoCalibrate has no counterpart of a pair (two lens models, fisheye lenses, points that only one of both
saw), cv2.registerCameras (5.0) estimates the relative pose from intrinsics that are held; camcal fits the pair with the
same intrinsics held. Fisheye pairs with all parameters go to cv2.fisheye.stereoCalibrate.
"""
