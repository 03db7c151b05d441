"""Time of the joint calibration of a rig against the calibrations of its cameras alone.

    python benchmarks/rig.py [--cameras 4] [--instants 100] [--points 9x6] [--repeat 3]

The rig looks at a board of 54 points at 100 instants, with noise of .2 px. `alone` is the sum over the cameras of
`camcal.calibrate`, `rig` is `camcal.calibrate_rig`, both without checks and without comparing with OpenCV; `together`
is the joint refinement alone, from the start that the cameras give. Each figure is the smallest of the repetitions;
the largest memory of the process stands below.
"""

from __future__ import annotations

import argparse
import resource
import time
from collections.abc import Callable

import numpy as np

import camcal
from camcal.data.observations import Observations
from camcal.data.rig_table import of_camera
from camcal.model import lenses
from camcal.model.camera import Camera
from camcal.model.pose import Pose, Poses
from camcal.model.rig import Rig

SIZE, NOISE = (640, 480), 0.2


def simulated(
    cameras: int, instants: int, columns: int = 9, rows: int = 6, seed: int = 0
) -> tuple[Observations, Rig, Poses]:
    """Cameras on an arc, all of which see a board of 30 mm squares at every instant; the true rig and boards."""
    rng = np.random.default_rng(seed)
    lens = lenses.make("opencv5")
    values = {"fx": 600.0, "fy": 600.0, "cx": 319.5, "cy": 239.5, "k1": -0.2}
    camera = Camera(lens, lens.from_values(values), SIZE)
    names = [f"c{i}" for i in range(cameras)]
    places = {}
    for i, name in enumerate(names):
        at = i / max(cameras - 1, 1)
        turn = Pose.from_vector(np.array([0.0, 0.36 * at, 0.0]), np.zeros(3))
        places[name] = Pose(turn.rotation, np.array([-315.0 * at, 0.0, 18.0 * at]))
    rig = Rig.in_frame_of(names[0], dict.fromkeys(names, camera), places)
    x, y = np.meshgrid(np.arange(columns), np.arange(rows))
    board = np.c_[x.ravel(), y.ravel(), np.zeros(x.size)] * 30.0
    uv, boards = np.empty((cameras, instants, len(board), 2)), []
    for v in range(instants):
        turn = Pose.from_vector(rng.uniform(-0.4, 0.4, 3), np.zeros(3)).rotation
        middle = np.array([rng.uniform(-60, 60), rng.uniform(-50, 50), rng.uniform(850, 1050)])
        place = Pose(turn, middle - turn @ board.mean(0))
        boards.append(place)
        for i, seen in enumerate(rig.project(place.apply(board)).values()):
            uv[i, v] = seen
    uv += rng.normal(0, NOISE, uv.shape)
    shape = cameras, instants, len(board)
    data = Observations(
        xyz=np.broadcast_to(board, (*shape, 3)).reshape(-1, 3).copy(),
        uv=uv.reshape(-1, 2),
        view=np.broadcast_to(np.arange(instants)[None, :, None], shape).ravel().copy(),
        view_ids=tuple(map(str, range(instants))),
        camera=np.repeat(np.arange(cameras), instants * len(board)),
        cameras=tuple(names),
        image_sizes=(SIZE,) * cameras,
    )
    return data, rig, Poses.stack(boards)


def fastest(work: Callable[[], object], repeat: int) -> float:
    """The smallest time of some runs, seconds."""
    found = []
    for _ in range(repeat):
        begin = time.process_time()
        work()
        found.append(time.process_time() - begin)
    return min(found)


def main() -> None:
    """Print the times and their ratio."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cameras", type=int, default=4)
    parser.add_argument("--instants", type=int, default=100)
    parser.add_argument("--points", default="9x6")
    parser.add_argument("--repeat", type=int, default=3)
    asked = parser.parse_args()
    columns, rows = map(int, asked.points.split("x"))
    data, _, _ = simulated(asked.cameras, asked.instants, columns, rows)
    parts = [of_camera(data, name) for name in data.cameras]
    options = {"model": "opencv5", "robust": "auto", "checks": False}
    alone = fastest(lambda: [camcal.calibrate(p, **options) for p in parts], asked.repeat)
    rig = fastest(lambda: camcal.calibrate_rig(data, **options), asked.repeat)
    together = camcal.calibrate_rig(data, **options).fit.seconds
    print(f"{asked.cameras} cameras x {asked.instants} instants x {columns * rows} points")
    print(f"alone    {1e3 * alone:8.1f} ms")
    print(f"rig      {1e3 * rig:8.1f} ms   {rig / alone:.2f} times")
    print(f"together {1e3 * together:8.1f} ms")
    print(f"memory   {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:8.0f} MB")


if __name__ == "__main__":
    main()
