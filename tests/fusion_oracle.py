"""The paper's method as plain if/else code on SciPy rotations, for one walk: the oracle.

Written from the paper (section 3) and the decisions in docs/design/paper_map.md, without any of the
package's code, so that an error in one of the two shows.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

UNLOCALIZED, TRACKED, KEYFRAME, OPTIMIZED = range(4)


class Oracle:
    """VIO-APR, one frame at a time. Poses are (position, Rotation) or None."""

    def __init__(self, d_th=0.4, o_th=4.0, n=2, t=8):
        self.d_th, self.o_th, self.n, self.t = d_th, o_th, n, t
        self.forget()

    def forget(self):
        self.run, self.reference, self.left = [], None, 0

    def update(self, apr, vio, reset=False):
        """Returns (status, position, Rotation, number of confirmed predictions)."""
        if vio is None:
            self.forget()
            return UNLOCALIZED, None, None, 0
        if reset:
            self.forget()
        if apr is None:
            return self.tracked(vio)
        if self.left == 0:
            return self.align(apr, vio)
        self.left -= 1
        if self.agree((apr, vio), self.reference):
            return KEYFRAME, *apr, 1
        return OPTIMIZED, *self.place(vio), 0

    def tracked(self, vio):
        if self.reference is None:
            return UNLOCALIZED, None, None, 0
        return TRACKED, *self.place(vio), 0

    def align(self, apr, vio):
        if self.run and self.agree((apr, vio), self.run[-1]):
            self.run.append((apr, vio))
        else:
            self.run = [(apr, vio)]
        if len(self.run) < self.n + 1:
            return self.tracked(vio)
        self.reference = mean([a for a, _ in self.run]), mean([v for _, v in self.run])
        self.run, self.left = [], self.t
        return KEYFRAME, *apr, self.n + 1

    def agree(self, here, there):
        (apr, vio), (apr0, vio0) = here, there
        distance = abs(np.linalg.norm(apr[0] - apr0[0]) - np.linalg.norm(vio[0] - vio0[0]))
        angles = [(p[1].inv() * p0[1]).magnitude() for p, p0 in ((apr, apr0), (vio, vio0))]
        return distance <= self.d_th and abs(angles[0] - angles[1]) <= np.deg2rad(self.o_th)

    def place(self, vio):
        (apr_x, apr_q), (vio_x, vio_q) = self.reference
        turn = apr_q * vio_q.inv()
        return turn.apply(vio[0] - vio_x) + apr_x, turn * vio[1]


def mean(poses):
    points = np.array([position for position, _ in poses])
    median = points.mean(axis=0)
    for _ in range(40):
        weights = 1 / np.maximum(np.linalg.norm(points - median, axis=1), 1e-77)
        median = (weights[:, None] * points).sum(axis=0) / weights.sum()
    return median, Rotation.concatenate([rotation for _, rotation in poses]).mean()
