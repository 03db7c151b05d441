"""Small pictures of checkerboards, supersampled through a homography: independent of camcal's renderer."""

from __future__ import annotations

import cv2
import numpy as np


def homography(size, centre, square, turn=0.0, tilt=0.0, about=0.0):
    """px from board (squares): its middle at `centre`, `square` px there, turned and tilted (radians)."""
    c, s = np.cos(turn), np.sin(turn)
    ca, sa = np.cos(about), np.sin(about)
    spin = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    axis = np.array([[ca, -sa, 0], [sa, ca, 0], [0, 0, 1]])
    lean = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
    rotation = axis @ lean @ axis.T @ spin
    distance = 3.0 * max(size)
    middle = np.array([(size[0] - 1) / 2, (size[1] - 1) / 2, 0])
    translation = np.array([0, 0, distance]) - rotation @ middle
    focal = square * distance
    k = np.array([[focal, 0, centre[0]], [0, focal, centre[1]], [0, 0, 1]])
    return k @ np.c_[rotation[:, :2], translation]


def project(h, xy):
    q = np.c_[xy, np.ones(len(xy))] @ h.T
    return q[:, :2] / q[:, 2:]


def corners(size, h):
    x, y = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
    return project(h, np.c_[x.ravel(), y.ravel()])


def light(
    h, size, picture, blur=0.8, black=40.0, white=210.0, background=120.0, margin=1.5, slope=0.0, samples=4
):
    """Noise-free grey values, float, of a board of `size` inner corners whose first square is black."""
    width, height = picture
    step = (np.arange(samples) + 0.5) / samples - 0.5
    u = (np.arange(width)[:, None] + step).ravel()
    v = (np.arange(height)[:, None] + step).ravel()
    inverse = np.linalg.inv(h)
    x, y, w = (inverse[i, 0] * u + inverse[i, 1] * v[:, None] + inverse[i, 2] for i in range(3))
    x, y = x / w, y / w
    sheet = (x > -margin) & (x < size[0] - 1 + margin) & (y > -margin) & (y < size[1] - 1 + margin)
    board = (x > -1) & (x < size[0]) & (y > -1) & (y < size[1])
    dark = np.where(board, 0.5 + 0.5 * stripes(x) * stripes(y), 0.0)
    fine = np.where(sheet, white + (black - white) * dark, background).astype(np.float32)
    if blur:  # of the samples, not of the pixels: those know nothing of what lies between them
        reach = 2 * int(np.ceil(4 * blur * samples)) + 1
        fine = cv2.GaussianBlur(fine, (reach, reach), blur * samples, borderType=cv2.BORDER_REPLICATE)
    coarse = fine.reshape(height, samples, width, samples).mean((1, 3), dtype=float)
    return coarse * (1 + slope * (np.arange(width) - width / 2) / width)


def stripes(x):
    """+1 where floor(x) is even, -1 where it is odd, in between where a line crosses the sample."""
    line = np.rint(x)
    width = np.hypot(*np.gradient(x))
    return np.clip(2 * (x - line) / width, -1, 1) * np.where(line % 2 == 0, 1, -1)


def picture(h, size=(6, 5), shape=(240, 200), noise=1.0, seed=0, **look):
    """An 8-bit picture."""
    values = light(h, size, shape, **look)
    noise = np.random.default_rng(seed).normal(0, noise, values.shape) if noise else 0.0
    return np.clip(np.rint(values + noise), 0, 255).astype(np.uint8)
