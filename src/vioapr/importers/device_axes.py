"""From what a browser says in a phone's own axes to the camera's axes and heading.

W3C's device axes are those of the phone held upright before one's face: x to the right of the
screen, y up along it, z out of it, to the person. They do not turn with the screen's content; the
camera's image does. The rear camera looks along -z.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_LEAST_LEVEL = 0.17
"""Length of the view's horizontal part, below which a camera within 10 degrees of the vertical
looks nowhere."""


def cam_from_device(
    vector: NDArray[np.float64], screen_deg: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Vectors in the axes of the rear camera's image: x right, y down, z forward.

    Args:
        vector: Shape (n, 3), in device axes.
        screen_deg: Shape (n,), the screen's angle (`screen.orientation.angle`): 90 when the phone
            was turned to the left, so that its right edge is up.
    """
    angle = np.radians(screen_deg)
    cos, sin = np.cos(angle), np.sin(angle)
    x, y, z = vector.T
    right, up = cos * x - sin * y, sin * x + cos * y
    return np.stack([right, -up, -z], axis=1)


def view_heading_deg(angles_deg: NDArray[np.float64]) -> NDArray[np.float64]:
    """Where the rear camera looks, clockwise from north, 0 to 360; NaN near the vertical.

    Args:
        angles_deg: alpha, beta, gamma of an absolute `deviceorientation` event, shape (n, 3): the
            device in a world of x east, y north, z up is turned by Rz(alpha) Rx(beta) Ry(gamma).
    """
    alpha, beta, gamma = np.radians(angles_deg.T)
    east = -np.cos(alpha) * np.sin(gamma) - np.sin(alpha) * np.sin(beta) * np.cos(gamma)
    north = np.cos(alpha) * np.sin(beta) * np.cos(gamma) - np.sin(alpha) * np.sin(gamma)
    heading = np.degrees(np.arctan2(east, north)) % 360.0
    return np.where(np.hypot(east, north) < _LEAST_LEVEL, np.nan, heading)
