"""What the tests of tracking share: estimators by name, sequences as lists, and cameras to compare with."""

import json

import numpy as np

from camcal.geometry import projective
from camcal.registry import look_up
from camcal.settings.tracking import TrackOptions
from camcal.track import ESTIMATORS
from camcal.track.frames import Frame
from camcal.track.keep import pack, unpack
from camcal.track.physical_model import Physical
from camcal.track.simulate import SEQUENCES, Scene, simulate

METHODS = list(ESTIMATORS)
#: of what a filter is told beforehand; rls and batch know no motion
KNOWS_MOTION = ("kalman", "iekf", "window", "smoother")


def make(method, **options):
    return look_up(ESTIMATORS, method, "method")(TrackOptions(**options))


def made_for(method, kind, **options):
    """An estimator that is told the motion of a sequence, as far as it takes one."""
    motion = {"motion": SEQUENCES[kind]} if method in KNOWS_MOTION else {}
    return make(method, **{**motion, **options})


def sequence(kind, count, seed=0, **scene):
    """Frames and truths of a simulated sequence, as two lists."""
    pairs = list(simulate(kind, count, seed, Scene(**scene)))
    return [f for f, _ in pairs], [t for _, t in pairs]


def follow(estimator, frames):
    """The final states of all frames."""
    states = [s for s in map(estimator.update, frames) if s is not None]
    last = list(estimator.finish())
    return last if estimator.offline else states


def true_estimate(model, truth):
    """The truth in the coordinates of a model."""
    if model.has_skew and not hasattr(model, "lens"):
        return model.from_matrix(truth.matrix)
    k = truth.k
    params = model.lens.pinhole(k[0, 0], k[1, 1], k[0, 2], k[1, 2])
    return Physical(params, truth.rotation, truth.translation)


def nees(estimator, state, truth):
    """Normalised estimation error squared, of size degrees of freedom."""
    error = estimator.model.local(state.estimate, true_estimate(estimator.model, truth))
    deviates = np.linalg.solve(state.factor, error)
    return float(deviates @ deviates)


def projection_error(estimator, state, truth, xyz):
    """Largest distance between where the estimate and the truth project points, px."""
    matrix = estimator.model.describe([state.estimate], [state.factor]).matrix[0]
    return float(np.abs(projective.project(matrix, xyz) - projective.project(truth.matrix, xyz)).max())


def with_points(frame, rows):
    return Frame(frame.number, frame.xyz[rows], frame.uv[rows], frame.sigma, frame.time)


def round_trip(content):
    """What a checkpoint gives back of what it was given."""
    return json.loads(json.dumps(pack(content)), object_hook=unpack)
