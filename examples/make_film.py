"""A film of the pictures in a folder, each shown for ten frames.

python examples/make_film.py FOLDER film.avi
"""

import sys
from pathlib import Path

import cv2

if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    pictures = [cv2.imread(str(p)) for p in sorted(Path(sys.argv[1]).glob("*.jpg"))]
    height, width = pictures[0].shape[:2]
    film = cv2.VideoWriter(sys.argv[2], cv2.VideoWriter_fourcc(*"MJPG"), 25, (width, height))
    for picture in pictures:
        for _ in range(10):
            film.write(picture)
    film.release()
