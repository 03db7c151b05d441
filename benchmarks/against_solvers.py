"""camcal's refinement against other solvers on the same problem: pycolmap, pyceres, mrcal, scipy.

All begin from the closed form's camera and poses, estimate fx fy cx cy k1 k2 p1 p2 and the poses, and are told
to go on to the last digit. What each returns is evaluated by one and the same function in extended precision;
printed are the relative excess of that cost over the lowest, and the median processor time of a solution against
camcal's.

- pycolmap: Ceres with derivatives by automatic differentiation in C++, its bundle adjuster with fixed points;
- pyceres: Ceres with cv2.projectPoints as the cost function of a view, called from Python;
- mrcal: libdogleg, from Debian's packages (`apt-get install python3-mrcal`), in the system's interpreter.

A solver that cannot be loaded is skipped with a word. Usage: python benchmarks/against_solvers.py [--runs 3]
"""

from __future__ import annotations

import argparse
import importlib.util
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from refine import SIZE, simulate
from tables import markdown, update

from camcal.data.observations import Correspondences
from camcal.geometry import rotations
from camcal.model.camera import Camera
from camcal.model.pose import Poses
from camcal.plan.calibrate import first_estimate
from camcal.solve.optimizers import make
from camcal.solve.problem import Problem

CASES = [(10, 9, 6), (50, 9, 6), (200, 9, 6), (50, 20, 20)]
MODEL = "opencv4"


@dataclass(frozen=True)
class Task:
    """A calibration to be solved."""

    data: Correspondences
    camera: Camera
    poses: Poses
    shape: tuple[int, int]  #: rows and columns of the board
    runs: int


@dataclass(frozen=True)
class Answer:
    """Parameters (8,), poses, and the seconds of each run."""

    params: np.ndarray
    poses: Poses
    seconds: list[float]


class Missing(Exception):
    """The solver is not installed."""


def exact_cost(task: Task, answer: Answer) -> float:
    """½ Σ |r|² in extended precision, from the rotation matrices and parameters of an answer."""
    fx, fy, cx, cy, k1, k2, p1, p2 = answer.params.astype(np.longdouble)
    total = np.longdouble(0)
    for view, rotation, shift in zip(
        task.data.views, answer.poses.rotations, answer.poses.translations, strict=True
    ):
        x, y, z = (view.xyz.astype(np.longdouble) @ rotation.astype(np.longdouble).T + shift).T
        a, b = x / z, y / z
        s = a * a + b * b
        f = 1 + s * (k1 + s * k2)
        u = fx * (a * f + 2 * p1 * a * b + p2 * (s + 2 * a * a)) + cx
        v = fy * (b * f + p1 * (s + 2 * b * b) + 2 * p2 * a * b) + cy
        total += ((u - view.uv[:, 0]) ** 2 + (v - view.uv[:, 1]) ** 2).sum()
    return total / 2


def timed(solve: Callable[[], Answer], runs: int) -> Answer:
    """The answer of the last run with the times of all."""
    seconds = []
    for _ in range(runs):
        begin = time.process_time()
        answer = solve()
        seconds.append(time.process_time() - begin if not answer.seconds else answer.seconds[0])
    return Answer(answer.params, answer.poses, seconds)


def with_camcal(spec: str) -> Callable[[Task], Answer]:
    def solve(task: Task) -> Answer:
        def once() -> Answer:
            problem = Problem(task.camera.lens, task.data.views, np.eye(8))
            result = make(spec)(problem, problem.state(task.camera.params, task.poses))
            return Answer(result.state.params, problem.poses(result.state), [])

        return timed(once, task.runs)

    return solve


def with_pycolmap(task: Task) -> Answer:
    if importlib.util.find_spec("pycolmap") is None:
        raise Missing("pip install pycolmap")
    import pycolmap

    views = task.data.views

    def once() -> Answer:
        scene = pycolmap.Reconstruction()
        scene.add_camera_with_trivial_rig(
            pycolmap.Camera(
                camera_id=1, model="OPENCV", width=SIZE[0], height=SIZE[1], params=task.camera.params
            )
        )
        points = [scene.add_point3D(x, pycolmap.Track(), np.zeros(3, np.uint8)) for x in views[0].xyz]
        config = pycolmap.BundleAdjustmentConfig()
        for number, (view, pose) in enumerate(zip(views, task.poses, strict=True), 1):
            seen = pycolmap.Point2DList(
                [pycolmap.Point2D(uv, point) for uv, point in zip(view.uv, points, strict=True)]
            )
            image = pycolmap.Image(image_id=number, name=view.id, camera_id=1, points2D=seen)
            rotation = pycolmap.Rotation3d(pose.rotation)
            scene.add_image_with_trivial_frame(image, pycolmap.Rigid3d(rotation, pose.translation))
            for index, point in enumerate(points):
                scene.point3D(point).track.add_element(number, index)
            config.add_image(number)
        for point in points:
            config.add_constant_point(point)
        options = pycolmap.BundleAdjustmentOptions()
        options.refine_principal_point, options.print_summary = True, False
        solver = options.ceres.solver_options
        solver.function_tolerance = solver.gradient_tolerance = solver.parameter_tolerance = 1e-16
        solver.max_num_iterations = 200
        adjuster = pycolmap.create_default_bundle_adjuster(options, config, scene)
        begin = time.process_time()
        adjuster.solve()
        seconds = time.process_time() - begin
        found = [scene.image(number).cam_from_world() for number in range(1, len(views) + 1)]
        poses = Poses(
            np.array([f.rotation.matrix() for f in found]), np.array([f.translation for f in found])
        )
        return Answer(np.array(scene.camera(1).params), poses, [seconds])

    return timed(once, task.runs)


def with_pyceres(task: Task) -> Answer:
    if importlib.util.find_spec("pyceres") is None:
        raise Missing("pip install pyceres")
    import pyceres

    class View(pyceres.CostFunction):
        """The residuals of a view over camera (8) and pose (rotation vector, translation)."""

        def __init__(self, xyz: np.ndarray, uv: np.ndarray):
            super().__init__()
            self.xyz, self.uv = np.ascontiguousarray(xyz), uv
            self.set_num_residuals(2 * len(xyz))
            self.set_parameter_block_sizes([8, 6])

        def Evaluate(self, parameters, residuals, jacobians):
            c, p = parameters
            k = np.array([[c[0], 0, c[2]], [0, c[1], c[3]], [0, 0, 1.0]])
            uv, j = cv2.projectPoints(self.xyz, p[:3].copy(), p[3:].copy(), k, c[4:].copy())
            residuals[:] = (uv.reshape(-1, 2) - self.uv).ravel()
            if jacobians is not None:
                if jacobians[0] is not None:
                    jacobians[0][:] = j[:, 6:14].ravel()
                if jacobians[1] is not None:
                    jacobians[1][:] = j[:, :6].ravel()
            return True

    def once() -> Answer:
        camera = task.camera.params.copy()
        poses = [np.r_[rotations.log(p.rotation), p.translation] for p in task.poses]
        problem = pyceres.Problem()
        for view, pose in zip(task.data.views, poses, strict=True):
            problem.add_residual_block(View(view.xyz, view.uv), None, [camera, pose])
        options = pyceres.SolverOptions()
        options.linear_solver_type = pyceres.LinearSolverType.SPARSE_SCHUR
        options.function_tolerance = options.gradient_tolerance = options.parameter_tolerance = 1e-16
        options.max_num_iterations = 200
        options.minimizer_progress_to_stdout = False
        begin = time.process_time()
        pyceres.solve(options, problem, pyceres.SolverSummary())
        seconds = time.process_time() - begin
        found = np.array(poses)
        return Answer(camera, Poses(rotations.exp(found[:, :3]), found[:, 3:]), [seconds])

    return timed(once, task.runs)


def with_mrcal(task: Task) -> Answer:
    interpreters = [sys.executable, shutil.which("python3", path="/usr/bin") or sys.executable]
    for interpreter in dict.fromkeys(interpreters):
        if subprocess.run([interpreter, "-c", "import mrcal"], capture_output=True).returncode == 0:
            break
    else:
        raise Missing("apt-get install python3-mrcal")
    rows, columns = task.shape
    seen = np.stack([np.c_[v.uv, np.ones(len(v))].reshape(rows, columns, 3) for v in task.data.views])
    frames = np.c_[rotations.log(task.poses.rotations), task.poses.translations]
    with tempfile.TemporaryDirectory() as folder:
        given, made = Path(folder) / "in.npz", Path(folder) / "out.npz"
        np.savez(given, seen=seen, frames=frames, intrinsics=task.camera.params, size=SIZE, runs=task.runs)
        worker = Path(__file__).with_name("mrcal_worker.py")
        subprocess.run([interpreter, worker, given, made], check=True, capture_output=True)
        found = np.load(made)
        poses = Poses(rotations.exp(found["frames"][:, :3]), found["frames"][:, 3:])
        return Answer(found["intrinsics"], poses, found["seconds"].tolist())


SOLVERS: dict[str, Callable[[Task], Answer]] = {
    "camcal lm": with_camcal("lm"),
    "camcal lm:qr": with_camcal("lm:qr"),
    "pycolmap": with_pycolmap,
    "pyceres": with_pyceres,
    "mrcal": with_mrcal,
    "scipy": with_camcal("scipy"),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--update", type=Path, help="a page whose table is to be renewed")
    told = parser.parse_args()
    table = []
    for case in CASES:
        data = simulate(*case)
        usable, camera, poses, _ = first_estimate(data, MODEL)
        task = Task(usable, camera, poses, (case[2], case[1]), told.runs)
        answers: dict[str, Answer] = {}
        for name, solve in SOLVERS.items():
            if name == "scipy" and case[0] > 50:
                continue  # a dense Jacobian of 1e7 entries, once an iteration
            try:
                answers[name] = solve(task)
            except Missing as hint:
                print(f"{name} is not installed here, skipped ({hint})")
        costs = {name: exact_cost(task, answer) for name, answer in answers.items()}
        lowest = min(costs.values())
        base = float(np.median(answers["camcal lm"].seconds))
        for name, answer in answers.items():
            seconds = float(np.median(answer.seconds))
            excess = float(costs[name] / lowest - 1)
            row = [f"{case[0]} x {case[1] * case[2]}", name, f"{excess:.1e}"]
            table.append([*row, f"{1e3 * seconds:.1f}", f"{seconds / base:.2f}"])
            print("  ".join(f"{cell:>14}" for cell in table[-1]), flush=True)
    text = markdown(["views x points", "solver", "cost above lowest", "ms", "time against camcal"], table)
    if told.update:
        update(told.update, "against-solvers", text)


if __name__ == "__main__":
    main()
