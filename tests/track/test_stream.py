"""Frames out of text: what is read, what is missing, what is refused and where."""

import io
import os
import re
import threading

import numpy as np
import pytest

from camcal.errors import DataError
from camcal.track.stream import FrameReader

HEADER = b"frame,X,Y,Z,u,v\n"


def read(text):
    return list(FrameReader(io.BytesIO(text), "points.csv"))


def test_frames_of_a_table():
    frames = read(HEADER + b"0,1,2,3,4,5\n0,2,2,3,4,5\n1,1,2,3,4,6\n")
    assert [f.number for f in frames] == [0, 1] and [len(f) for f in frames] == [2, 1]
    np.testing.assert_array_equal(frames[0].xyz, [[1, 2, 3], [2, 2, 3]])
    np.testing.assert_array_equal(frames[1].uv, [[4, 6]])
    assert frames[0].sigma is None and frames[0].time is None


@pytest.mark.parametrize(
    "text",
    [
        b"0,1,2,3,4,5\n1,1,2,3,4,5\n",
        b"\xef\xbb\xbfframe;X;Y;Z;u;v\r\n0;1;2;3;4;5\r\n1;1;2;3;4;5\r\n",
        b"# made by hand\nframe X Y Z u v\n0 1 2 3 4 5\n# between\n1  1 2 3 4 5",
        b"v,u,Z,Y,X,Frame\n5,4,3,2,1,0\n5,4,3,2,1,1\n",
        b"Image,id,x,y,z,px,py\n0,9,1,2,3,4,5\n1,9,1,2,3,4,5\n",
        b"view\tx\ty\tz\tu\tv\n0\t1\t2\t3\t4\t5\n1\t1\t2\t3\t4\t5\n".replace(b"x\ty\tz", b"X\tY\tZ"),
    ],
)
def test_forms_of_a_table(text):
    frames = read(text)
    assert [f.number for f in frames] == [0, 1]
    np.testing.assert_array_equal(frames[1].xyz, [[1, 2, 3]])


def test_sigma_and_time():
    (frame,) = read(b"frame,t,X,Y,Z,u,v,sigma\n7,0.5,1,2,3,4,5,0.3\n7,0.5,1,2,3,4,5,0.4\n")
    assert frame.time == 0.5
    np.testing.assert_array_equal(frame.sigma, [0.3, 0.4])


def test_missing_points_leave_their_frame():
    frames = read(HEADER + b"0,1,2,3,,\n0,1,2,3,4,5\n1,1,2,3,nan,5\n2,1,2,3,4,5\n")
    assert [(f.number, len(f)) for f in frames] == [(0, 1), (1, 0), (2, 1)]


def test_a_frame_that_comes_in_pieces_is_one(monkeypatch):
    monkeypatch.setattr("camcal.track.stream.BLOCK", 7)
    rows = [f"{i // 5},{i},2,3,4,{i}.25" for i in range(23)]
    frames = read(HEADER + "\n".join(rows).encode())
    assert [len(f) for f in frames] == [5, 5, 5, 5, 3]
    assert np.concatenate([f.xyz[:, 0] for f in frames]).tolist() == list(range(23))


def test_a_number_that_comes_again_is_a_frame_of_its_own():
    assert [f.number for f in read(HEADER + b"0,1,2,3,4,5\n1,1,2,3,4,5\n0,1,2,3,4,5\n")] == [0, 1, 0]


def test_an_empty_line_ends_a_frame_at_once():
    reading, writing = os.pipe()
    frames = []
    seen = threading.Event()

    def consume():
        with os.fdopen(reading, "rb") as stream:
            for frame in FrameReader(stream, "pipe"):
                frames.append(frame.number)
                seen.set()

    thread = threading.Thread(target=consume)
    thread.start()
    with os.fdopen(writing, "wb", buffering=0) as stream:
        stream.write(HEADER + b"0,1,2,3,4,5\n\n")
        assert seen.wait(10) and frames == [0]
        stream.write(b"1,1,2,3,4,5\n")
    thread.join(10)
    assert frames == [0, 1]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (b"", "no frames"),
        (HEADER, "no frames"),
        (b"frame,X,Y,Z,u\n0,1,2,3,4\n", "lacks v"),
        (b"frame,X,Y,Z,u,v,w\n", "unknown column 'w'"),
        (b"frame,X,Y,Z,u,u\n", "'u' and 'u' both mean u"),
        (b"frame,X,Y,Z,x,y\n", "'X' and 'x' both mean X"),
        (b"0,1,2,3,4,5,6\n", "7 columns without a header"),
        (HEADER + b"0,1,2,3,4,5\n0,1,2,3,4\n", "points.csv:3: 5 fields"),
        (HEADER + b"0,1,2,3,4,5\n\n0,1,2,3,4,5,6\n", "points.csv:4: 7 fields"),
        (HEADER + b"0,1,2,3,4,five\n", "points.csv:2: 'five' in column v"),
        (HEADER + b"0,1,2,3,4,5\n1,1,2,3,inf,5\n", "points.csv:3: infinite"),
        (HEADER + b"0.5,1,2,3,4,5\n", "points.csv:2: the frame is not a whole number"),
        (HEADER + b",1,2,3,4,5\n", "points.csv:2: the frame is not a whole number"),
        (b"frame,X,Y,Z,u,v,sigma\n0,1,2,3,4,5,0\n", "points.csv:2: sigma is not positive"),
        (b"frame,X,Y,Z,u,v,sigma\n0,1,2,3,4,5,\n", "frame 0 has points without a sigma"),
        (b"\x89PNG\r\n\x1a\n\xff\xfe\n", "not a text file"),
    ],
)
def test_what_is_refused(text, said):
    with pytest.raises(DataError, match=re.escape(said)) as caught:
        read(text)
    assert caught.value.hint


class Endless:
    """A stream of one line without an end; it counts what was taken."""

    taken = 0

    def read(self, size):
        self.taken += 4096
        return b"7" * 4096


def test_a_line_without_an_end_is_refused_early():
    stream = Endless()
    with pytest.raises(DataError, match=r"pipe:1: a line of more than 1048576 bytes"):
        next(iter(FrameReader(stream, "pipe")))
    assert stream.taken <= 2**20 + 4096
