"""Hand-eye calibration: a camera mounted on a robot's hand, or a stationary one that observes the hand.

With the robot's pose B_i = base_from_hand and C_i = cam_from_board at view i, both set-ups obey one equation:

    G_i Z = X C_i                                                                                        (1)

in-hand  G_i = B_i⁻¹   X = hand_from_camera   Z = base_from_board
to-hand  G_i = B_i     X = base_from_camera   Z = hand_from_board

Between two views, the robot moves by A = G_i G_j⁻¹ and the camera by B = C_i C_j⁻¹, and A X = X B.

The tables import nothing, so that help stays fast.
"""

from __future__ import annotations

#: solves (1) in closed form: name -> function of `Views` that returns (X, Z)
CLOSED_FORMS: dict[str, str] = {
    "tsai": "camcal.routes.hand_eye.tsai:solve",
    "park": "camcal.routes.hand_eye.park:solve",
    "horaud": "camcal.routes.hand_eye.horaud:solve",
    "andreff": "camcal.routes.hand_eye.andreff:solve",
    "daniilidis": "camcal.routes.hand_eye.daniilidis:solve",
    "shah": "camcal.routes.hand_eye.shah:solve",
    "li": "camcal.routes.hand_eye.li:solve",
}

CLOSED_FORM_SUMMARIES: dict[str, str] = {
    "tsai": "Tsai & Lenz 1989: axes of the motions by modified Rodrigues vectors, then the translation.",
    "park": "Park & Martin 1994: logarithms of the rotations, then the translation.",
    "horaud": "Horaud & Dornaika 1995: unit quaternions, then the translation.",
    "andreff": "Andreff, Horaud & Espiau 1999: rotation and translation at once, linearly.",
    "daniilidis": "Daniilidis 1999: dual quaternions, rotation and translation at once.",
    "shah": "Shah 2013: both rotations by the SVD of a Kronecker product, then both translations.",
    "li": "Li, Wang & Wu 2010: both transformations at once by Kronecker products.",
}

SETUPS = ("in-hand", "to-hand")
#: names of X and Z in a report, by set-up
NAMES = {
    "in-hand": ("hand_from_camera", "base_from_board"),
    "to-hand": ("base_from_camera", "hand_from_board"),
}
